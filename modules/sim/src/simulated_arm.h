// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "arm_errors.h"
#include "moving_arm.h"
#include "servocal/core/clock.h"
#include "servocal/robot/arm.h"

namespace servocal::sim {

/// An arm under velocity control, on a fixed grid of 2 ms ticks. Ticks are computed when somebody asks
/// for what happened; a command acts from the next tick on.
///
/// What it reports is what a controller believes (encoders and nominal kinematics, at 125 Hz); where the
/// flange really is, flangeAt() tells the simulated cameras alone.
class SimulatedArm final : public robot::Arm, public MovingArm {
 public:
  SimulatedArm(const SimulatedClock& clock, const CellConfig& config, std::uint64_t seed);

  const robot::ArmInfo& info() const override { return info_; }
  RobotState state() override;
  RobotState stateAt(Instant stamp) override;
  void move(robot::MotionKey, const Twist<Base>& twist, Duration valid_for) override;
  void moveJoints(robot::MotionKey, const Eigen::VectorXd& speeds_radps, Duration valid_for) override;
  void stop(robot::MotionKey) override;

  Eigen::Isometry3d flangeAt(Instant instant) override;
  /// Where the flange is at these joint angles, but for repeatability.
  Eigen::Isometry3d flangeOf(const Joints& q) const { return real_->forward(q); }
  /// Joint angles at that instant, without encoder noise.
  Joints jointsAt(Instant instant);
  std::vector<Eigen::Isometry3d> nominalFrames(Instant instant) override;

 private:
  struct Tick {
    std::int64_t index = 0;
    Joints q;
    Joints speed;
    double travelled_rad = 0.0;  ///< Length of the joint path so far.
  };

  void catchUp();
  void step();
  Joints wantedSpeed(Instant instant) const;
  Tick tickAt(Instant instant);
  RobotState report(const Tick& tick) const;
  RobotState reportAt(std::int64_t index) const;
  const Tick& stored(std::int64_t index) const;

  const SimulatedClock& clock_;
  robot::ArmInfo info_;
  std::unique_ptr<const ArmChain> nominal_;
  std::unique_ptr<const ArmChain> real_;
  Repeatability repeatability_;
  double max_speed_radps_;
  double max_acceleration_radps2_;
  double device_clock_offset_s_;
  std::uint64_t noise_seed_;
  std::deque<Tick> ticks_;  ///< Of the last seconds; never empty.
  Twist<Base> command_;
  std::optional<Joints> joint_command_;  ///< Instead of the twist.
  Instant command_end_{};
  std::optional<std::string> protective_stop_;
};

}  // namespace servocal::sim
