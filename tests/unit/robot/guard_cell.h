// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <memory>

#include "fake_arm.h"
#include "servocal/robot/guard.h"

namespace servocal::robot {

inline MotionLimits openLimits() {
  MotionLimits limits;
  limits.workspace = {"workspace", Eigen::Vector3d::Constant(-10), Eigen::Vector3d::Constant(10)};
  return limits;
}

inline const Pose<EndEffector, Board> kMount =
    Pose<EndEffector, Board>::fromRotationVector({3.1, 0.0, 0.0}, {0.0, 0.0, 0.05});

/// An arm with its guard, and what the arm was seen to do.
struct Cell {
  explicit Cell(const MotionLimits& limits = openLimits(), const GuardOptions& options = {},
                const ArmConfig& config = {}, Eigen::VectorXd start = {},
                const test::FakeArmOptions& fake = {})
      : kinematics(config),
        arm(kinematics, clock,
            start.size() ? start : (Eigen::VectorXd(6) << 1.0, -0.6, -1.5, 1.8, 1.2, 0.0).finished(), fake) {
    guard = std::make_unique<Guard>(arm, kinematics, clock, limits, board, options);
    guard->setBoard(std::nullopt);
    arm.on_step = [this](const RobotState& state) { watch(state); };
  }

  // Commands the same twist for a while; returns the last verdict.
  GuardVerdict hold(const Twist<Base>& twist, double seconds, double period = 0.008) {
    GuardVerdict verdict;
    for (const Instant end = clock.now() + fromSeconds(seconds); clock.now() < end;) {
      verdict = guard->command(twist);
      clock.sleepFor(fromSeconds(period));
      arm.state();
    }
    return verdict;
  }

  void watch(const RobotState& state) {
    fastest = std::max(fastest, state.twist.linear_mps.norm());
    fastest_turn = std::max(fastest_turn, state.twist.angular_radps.norm());
    for (const Eigen::Vector3d& corner_o : board.outline()) {
      const Eigen::Vector3d lever = state.bMe.rotation() * (kMount * corner_o);
      fastest_corner =
          std::max(fastest_corner, (state.twist.linear_mps + state.twist.angular_radps.cross(lever)).norm());
      corner_low = std::min(corner_low, (state.bMe * (kMount * corner_o)).z());
    }
    if (last_q.size())
      fastest_joint = std::max(
          fastest_joint, (state.q - last_q).cwiseAbs().maxCoeff() / toSeconds(state.stamp - last_stamp));
    last_q = state.q;
    last_stamp = state.stamp;
    lowest = std::min(lowest, state.bMe.translation().z());
    highest_q = highest_q.size() ? highest_q.cwiseMax(state.q) : state.q;
  }
  double z() { return arm.state().bMe.translation().z(); }

  SimulatedClock clock;
  BoardSpec board;
  Kinematics kinematics;
  test::FakeArm arm;
  std::unique_ptr<Guard> guard;
  double fastest = 0, fastest_turn = 0, fastest_corner = 0, fastest_joint = 0, lowest = 1e9, corner_low = 1e9;
  Eigen::VectorXd last_q, highest_q;
  Instant last_stamp{};
};

inline const Twist<Base> kDown{{0, 0, -0.2}, {0, 0, 0}};
inline const Twist<Base> kUp{{0, 0, 0.2}, {0, 0, 0}};
inline const Twist<Base> kTurn{{0, 0, 0}, {0, 0, 0.5}};

inline double largestAcceleration(const test::FakeArm& arm) {
  double largest = 0;
  for (std::size_t i = 1; i < arm.log().size(); ++i) {
    const double dt = toSeconds(arm.log()[i].at - arm.log()[i - 1].at);
    if (dt > 0)
      largest =
          std::max(largest, (arm.log()[i].twist.linear_mps - arm.log()[i - 1].twist.linear_mps).norm() / dt);
  }
  return largest;
}

}  // namespace servocal::robot
