// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <stdexcept>

#include "servocal/robot/arm.h"
#include "servocal/robot/kinematics.h"

namespace servocal::app {

/// An arm that stands and cannot move: there is no device behind it.
class StillArm final : public robot::Arm {
 public:
  StillArm(const robot::Kinematics& kinematics, const Eigen::VectorXd& q) {
    info_ = {"none", "", kinematics.joints(), 125.0};
    state_.q = q;
    state_.bMe = kinematics.forward(q);
    state_.twist = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  }
  const robot::ArmInfo& info() const override { return info_; }
  RobotState state() override { return state_; }
  RobotState stateAt(Instant) override { return state_; }
  void move(robot::MotionKey, const Twist<Base>&, Duration) override { refuse(); }
  void moveJoints(robot::MotionKey, const Eigen::VectorXd&, Duration) override { refuse(); }
  void stop(robot::MotionKey) override {}

 private:
  [[noreturn]] static void refuse() { throw std::logic_error("a dry run moves nothing"); }

  robot::ArmInfo info_;
  RobotState state_;
};

}  // namespace servocal::app
