// SPDX-License-Identifier: GPL-3.0-or-later
// A kinematic arm for tests: does what it is told, with no limit of its own, so that every limit kept is
// the guard's doing.
#pragma once

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <utility>
#include <vector>

#include "servocal/robot/arm.h"
#include "servocal/robot/kinematics.h"

namespace servocal::test {

struct FakeArmOptions {
  double lag_s = 0.0;  ///< Time constant of the joints' first-order response to a command; 0: immediate.
  double braking_mps2 = 1.2;     ///< Of the arm's own braking, when commands cease
  double braking_radps2 = 2.4;
  double stop_factor = 5.0;      ///< and how much harder it brakes when told to stop.
  double state_rate_hz = 125.0;
  double step_s = 0.002;         ///< Of the integration.
};

/// Moves only when its clock has moved and somebody asks; history and log are complete.
class FakeArm final : public robot::Arm {
 public:
  struct Command {
    Instant at{};
    Twist<Base> twist;
    Duration valid_for{};
    bool stop = false;
    Eigen::VectorXd joints;  ///< rad/s; of a command of joint speeds, whose twist is then the one they make.
  };

  FakeArm(const robot::Kinematics& kinematics, Clock& clock, Eigen::VectorXd q,
          const FakeArmOptions& options = {})
      : kinematics_(kinematics), clock_(clock), options_(options), q_(std::move(q)), time_(clock.now()) {
    info_.model = "fake";
    info_.joints = kinematics.joints();
    history_.push_back(actual());
  }

  const robot::ArmInfo& info() const override { return info_; }
  RobotState state() override {
    advance(clock_.now());
    // Reported at the controller's rate: the newest of its ticks.
    const auto tick = fromSeconds(1.0 / options_.state_rate_hz);
    return stateAt(Instant(tick * (clock_.now().time_since_epoch() / tick)));
  }
  RobotState stateAt(Instant stamp) override {
    advance(clock_.now());
    if (stamp <= history_.front().stamp) return history_.front();
    if (stamp >= history_.back().stamp) return history_.back();
    const auto after = std::lower_bound(history_.begin(), history_.end(), stamp,
                                        [](const RobotState& state, Instant at) { return state.stamp < at; });
    const RobotState& b = *after;
    const RobotState& a = *(after - 1);
    const double share = toSeconds(stamp - a.stamp) / toSeconds(b.stamp - a.stamp);
    RobotState result = a;
    result.stamp = stamp;
    result.device_stamp_s = toSeconds(stamp);
    result.q = a.q + share * (b.q - a.q);
    result.bMe = kinematics_.forward(result.q);
    return result;
  }
  void move(robot::MotionKey, const Twist<Base>& twist, Duration valid_for) override {
    advance(clock_.now());
    log_.push_back({clock_.now(), twist, valid_for, false, {}});
    goal_ = twist;
    take(Kind::kTwist, valid_for);
  }
  void moveJoints(robot::MotionKey, const Eigen::VectorXd& speeds_radps, Duration valid_for) override {
    advance(clock_.now());
    log_.push_back({clock_.now(), twistOf(speeds_radps), valid_for, false, speeds_radps});
    joint_goal_ = speeds_radps;
    take(Kind::kJoints, valid_for);
  }
  void stop(robot::MotionKey) override {
    advance(clock_.now());
    log_.push_back({clock_.now(), {}, {}, true, {}});
    goal_ = {};
    joint_goal_.setZero(q_.size());
    stopping_ = true;
  }

  const std::vector<Command>& log() const { return log_; }
  /// What the arm is told at an instant, commands that ran out counted as zero.
  Twist<Base> toldAt(Instant at) const {
    Twist<Base> told;
    for (const Command& command : log_)
      if (command.at <= at) told = !command.stop && at < command.at + command.valid_for ? command.twist : Twist<Base>{};
    return told;
  }
  /// Called after each step of the integration with the true state.
  std::function<void(const RobotState&)> on_step;
  bool corrupt = false;  ///< From the next command on, states hold NaN.

 private:
  enum class Kind { kTwist, kJoints };

  Twist<Base> twistOf(const Eigen::VectorXd& speeds) const {
    const Eigen::VectorXd twist = kinematics_.jacobian(q_) * speeds;
    return {twist.head<3>(), twist.tail<3>()};
  }
  Eigen::VectorXd speedsOf(const Twist<Base>& twist, const Eigen::VectorXd& q) const {
    Eigen::Matrix<double, 6, 1> stacked;
    stacked << twist.linear_mps, twist.angular_radps;
    return kinematics_.jacobian(q).completeOrthogonalDecomposition().solve(stacked);
  }

  bool late() const { return options_.lag_s > 0.0; }

  // What moves goes on as the other kind of motion.
  void take(Kind kind, Duration valid_for) {
    if (kind != kind_ && kind == Kind::kJoints && !late()) speeds_ = speedsOf(twist_, q_);
    kind_ = kind;
    expires_ = clock_.now() + valid_for;
    stopping_ = false;
    corrupt_states_ = corrupt;
  }

  RobotState actual() const {
    RobotState state;
    state.stamp = time_;
    state.device_stamp_s = toSeconds(time_);
    state.q = q_;
    state.bMe = kinematics_.forward(q_);
    state.twist = twist_;
    if (corrupt_states_) state.q.setConstant(std::numeric_limits<double>::quiet_NaN());
    return state;
  }

  // Towards zero along its own direction.
  void brake(double dt, double factor) {
    double time = std::max(twist_.linear_mps.norm() / (factor * options_.braking_mps2),
                           twist_.angular_radps.norm() / (factor * options_.braking_radps2));
    if (kind_ == Kind::kJoints)
      time = std::max(time, speeds_.cwiseAbs().maxCoeff() / (factor * options_.braking_radps2));
    const double left = time > dt ? 1.0 - dt / time : 0.0;
    twist_.linear_mps *= left;
    twist_.angular_radps *= left;
    speeds_ *= left;
  }

  void advance(Instant now) {
    while (time_ < now) {
      Instant next = std::min(now, time_ + fromSeconds(options_.step_s));
      if (!stopping_ && time_ < expires_) next = std::min(next, expires_);
      const double dt = toSeconds(next - time_);
      const double left = late() ? std::exp(-dt / options_.lag_s) : 0.0;
      if (stopping_) {
        brake(dt, options_.stop_factor);
      } else if (time_ >= expires_) {
        brake(dt, 1.0);
      } else if (kind_ == Kind::kJoints || late()) {
        const Eigen::VectorXd wanted = kind_ == Kind::kJoints ? joint_goal_ : speedsOf(goal_, q_);
        speeds_ = wanted + left * (speeds_ - wanted);
      } else {
        twist_ = goal_;
      }
      if (kind_ == Kind::kJoints || late()) {
        q_ += dt * speeds_;
        twist_ = twistOf(speeds_);
      } else if (!twist_.isZero()) {
        q_ += dt * speedsOf(twist_, q_ + 0.5 * dt * speedsOf(twist_, q_));  // Midpoint rule.
      }
      time_ = next;
      history_.push_back(actual());
      if (history_.size() > 4000) history_.pop_front();
      if (on_step) on_step(history_.back());
    }
  }

  const robot::Kinematics& kinematics_;
  Clock& clock_;
  FakeArmOptions options_;
  robot::ArmInfo info_;
  Eigen::VectorXd q_;
  Instant time_;
  Twist<Base> twist_, goal_;
  Eigen::VectorXd speeds_ = Eigen::VectorXd::Zero(q_.size()), joint_goal_ = speeds_;
  Kind kind_ = Kind::kTwist;
  Instant expires_{};
  bool stopping_ = true;
  bool corrupt_states_ = false;
  std::deque<RobotState> history_;
  std::vector<Command> log_;
};

}  // namespace servocal::test
