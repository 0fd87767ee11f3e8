// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <string>

#include "servocal/core/clock.h"
#include "servocal/core/observation.h"

namespace servocal::robot {

class Guard;

/// The right to move an arm. Only the Guard can make one.
class MotionKey {
  friend class Guard;
  MotionKey() {}  // Not "= default": that would leave an aggregate, which anybody may make with braces.
};

struct ArmInfo {
  std::string model;
  std::string serial;
  int joints = 0;
  double state_rate_hz = 125.0;
};

/// A robot arm that takes velocities and stops by itself when they cease.
class Arm {
 public:
  virtual ~Arm() = default;
  virtual const ArmInfo& info() const = 0;

  /// The newest state.
  /// @throws Error (kHardwareAbsent, kSafetyStop) if the arm is gone or stopped itself.
  virtual RobotState state() = 0;
  /// The state at `stamp`, interpolated from the recent past (at least the last second); the newest or
  /// oldest one if `stamp` lies outside.
  virtual RobotState stateAt(Instant stamp) = 0;

  /// Moves the end effector with this twist until the next command, at most for `valid_for`; then the
  /// arm brakes by itself.
  virtual void move(MotionKey, const Twist<Base>& twist, Duration valid_for) = 0;
  /// The same with speeds of the joints, rad/s.
  virtual void moveJoints(MotionKey, const Eigen::VectorXd& speeds_radps, Duration valid_for) = 0;
  /// Brakes to a stop.
  virtual void stop(MotionKey) = 0;
};

}  // namespace servocal::robot
