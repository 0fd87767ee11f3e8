// SPDX-License-Identifier: GPL-3.0-or-later
// Every limit twice: the arm keeps it with the guard, and breaks it without (the negative control).
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <regex>
#include <sstream>
#include <type_traits>

#include "guard_cell.h"

namespace servocal::robot {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kHuge = 1e9;

// In C++17 a class with a private "= default" constructor could still be made with braces.
template <class T, class = void>
struct CanBeMade : std::false_type {};
template <class T>
struct CanBeMade<T, std::void_t<decltype(T{})>> : std::true_type {};
static_assert(!CanBeMade<MotionKey>::value, "only the guard may make a MotionKey");

TEST(Guard, LetsAnInnocentCommandThrough) {
  Cell cell;
  const GuardVerdict verdict = cell.hold({{0.05, 0, 0}, {0, 0, 0.05}}, 0.5);
  EXPECT_EQ(verdict.rule, GuardRule::kNone) << verdict.reason;
  EXPECT_FALSE(verdict.refused());
  EXPECT_NEAR(verdict.applied.linear_mps.x(), 0.05, 1e-12);
}

TEST(Guard, KeepsTheSpeedLimits) {
  const Twist<Base> fast{{0, 0, 0.9}, {0, 0, 0}}, turning{{0, 0, 0}, {0, 0, 2}};
  Cell cell, turned;
  // The first command names the rule; later ones come near a singular pose, which is the stronger one.
  const GuardVerdict verdict = cell.hold(fast, 0.008);
  EXPECT_EQ(verdict.rule, GuardRule::kSpeed) << verdict.reason;
  EXPECT_FALSE(verdict.refused());
  cell.hold(fast, 0.25);
  EXPECT_LE(cell.fastest, 0.25 * (1 + 1e-9));
  EXPECT_GT(cell.fastest, 0.2);
  turned.hold(turning, 0.4);
  EXPECT_LE(turned.fastest_turn, 0.5 * (1 + 1e-9));
  EXPECT_GT(turned.fastest_turn, 0.3);

  MotionLimits without = openLimits();
  without.max_speed_mps = without.max_angular_speed_radps = without.max_joint_speed_radps = kHuge;
  Cell control(without), turned_control(without);
  control.hold(fast, 0.4);
  EXPECT_GT(control.fastest, 0.3);
  turned_control.hold(turning, 0.4);
  EXPECT_GT(turned_control.fastest_turn, 0.6);
}

// The flange moves within its limit; a far corner of the board would not.
TEST(Guard, KeepsTheSpeedLimitOfTheBoardToo) {
  const Twist<Base> both{{0.2, 0, 0}, {0, 0, 0.48}};
  Cell cell;
  cell.guard->setBoard(kMount);
  cell.hold(both, 1.0);
  EXPECT_LE(cell.fastest_corner, 0.25 * (1 + 1e-6));

  Cell control;  // No board on the arm, as far as the guard knows.
  control.hold(both, 1.0);
  EXPECT_GT(control.fastest_corner, 0.2505);
}

TEST(Guard, WhatRoundingLeavesOfAMotionIsRest) {
  Cell cell;
  cell.clock.sleepFor(fromSeconds(0.008));
  (void)cell.guard->commandJoints(Eigen::VectorXd::Constant(6, 1e-13));
  ASSERT_FALSE(cell.arm.log().back().joints.isZero(0.0));
  cell.clock.sleepFor(fromSeconds(0.020));
  (void)cell.guard->commandJoints(Eigen::VectorXd::Unit(6, 5));
  EXPECT_LE(cell.arm.log().back().joints.maxCoeff(), 2.4 * 0.008 * (1 + 1e-6));
  EXPECT_GT(cell.arm.log().back().joints.maxCoeff(), 0.0);
}

TEST(Guard, RampsUpAndBrakesWithinTheAccelerationLimits) {
  Cell cell;
  cell.hold({{0.25, 0, 0}, {0, 0, 0}}, 0.5);
  cell.hold({{-0.25, 0, 0}, {0, 0, 0.3}}, 0.5);
  cell.hold({}, 0.4);
  EXPECT_TRUE(cell.arm.log().back().twist.isZero());
  EXPECT_LE(largestAcceleration(cell.arm), 1.2 * (1 + 1e-6));
  EXPECT_GT(largestAcceleration(cell.arm), 1.1);

  MotionLimits without = openLimits();
  without.max_acceleration_mps2 = without.max_angular_acceleration_radps2 = kHuge;
  Cell control(without);
  control.hold({{0.25, 0, 0}, {0, 0, 0}}, 0.1);
  control.hold({}, 0.1);
  EXPECT_GT(largestAcceleration(control.arm), 10.0);
}

// Near the wrist's singularity a small twist asks for fast joints.
TEST(Guard, KeepsTheJointSpeedLimitNearASingularity) {
  const Eigen::VectorXd near_singular = (Eigen::VectorXd(6) << 1.0, -0.6, -1.5, 1.8, 0.12, 0.0).finished();
  const auto about_wrist = [](Cell& cell) {
    const Eigen::Matrix3d bRe = cell.arm.state().bMe.rotation();
    return Twist<Base>{{0, 0, 0}, bRe * Eigen::Vector3d(0.5, 0.0, 0.0)};
  };
  Cell cell(openLimits(), {}, {}, near_singular);
  const GuardVerdict verdict = cell.hold(about_wrist(cell), 0.5);
  EXPECT_GE(verdict.rule, GuardRule::kJointSpeed) << verdict.reason;
  EXPECT_LE(cell.fastest_joint, 1.0 * (1 + 1e-3));

  MotionLimits without = openLimits();
  without.max_joint_speed_radps = kHuge;
  Cell control(without, {}, {}, near_singular);
  control.hold(about_wrist(control), 0.5);
  EXPECT_GT(control.fastest_joint, 1.5);
}

TEST(Guard, RefusesMotionThatASingularPoseCannotMake) {
  Cell cell(openLimits(), {}, {}, (Eigen::VectorXd(6) << 0.5, -0.6, 0.0, 1.8, 1.2, 0.0).finished());
  // Outstretched: no joint motion pulls the wrist along the arm.
  const RobotState state = cell.arm.state();
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(cell.kinematics.jacobian(state.q), Eigen::ComputeFullU);
  ASSERT_LT(svd.singularValues()[5], 1e-9);
  const Eigen::VectorXd lost = svd.matrixU().col(5);
  const GuardVerdict verdict = cell.guard->command({0.1 * lost.head<3>(), 0.1 * lost.tail<3>()});
  EXPECT_EQ(verdict.rule, GuardRule::kJoint);
  EXPECT_TRUE(verdict.refused());
  EXPECT_TRUE(verdict.applied.isZero());
}

ArmConfig endlessJoints(const std::string& source_file) {
  std::ifstream source(source_file);
  std::ostringstream text;
  text << source.rdbuf();
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "endless.urdf";
  std::ofstream(file) << std::regex_replace(text.str(), std::regex("6\\.283185307179586"), "100");
  ArmConfig arm;
  arm.urdf = file.string();
  return arm;
}

TEST(Guard, KeepsAMarginFromJointLimits) {
  const Eigen::VectorXd near_limit =
      (Eigen::VectorXd(6) << 1.0, -0.6, -1.5, 1.8, 1.2, 2 * kPi - 0.3).finished();
  const auto turn_last = [](Cell& cell) {
    return Twist<Base>{{0, 0, 0}, cell.arm.state().bMe.rotation() * Eigen::Vector3d(0, 0, 0.5)};
  };
  Cell cell(openLimits(), {}, {}, near_limit);
  const GuardVerdict verdict = cell.hold(turn_last(cell), 2.0);
  EXPECT_EQ(verdict.rule, GuardRule::kJoint) << verdict.reason;
  EXPECT_TRUE(verdict.refused());
  EXPECT_NE(verdict.reason.find("Joint 6"), std::string::npos) << verdict.reason;
  EXPECT_LE(cell.highest_q[5], 2 * kPi - 0.05 + 1e-6);
  EXPECT_GT(cell.highest_q[5], 2 * kPi - 0.12);  // Near, all the same.
  const Twist<Base> back{{0, 0, 0}, -turn_last(cell).angular_radps};
  EXPECT_FALSE(cell.hold(back, 0.3).refused());

  Cell control(openLimits(), {}, endlessJoints(SERVOCAL_UR5_URDF), near_limit);
  control.hold(turn_last(control), 2.0);
  EXPECT_GT(control.highest_q[5], 2 * kPi);
}

TEST(Guard, KeepsTheFlangeInTheWorkspace) {
  MotionLimits limits = openLimits();
  Cell probe;
  limits.workspace.min_m.z() = probe.z() - 0.1;
  Cell cell(limits);
  const GuardVerdict verdict = cell.hold(kDown, 2.0);
  EXPECT_EQ(verdict.rule, GuardRule::kWorkspace);
  EXPECT_TRUE(verdict.refused());
  EXPECT_GE(cell.lowest, limits.workspace.min_m.z());
  EXPECT_LT(cell.lowest, limits.workspace.min_m.z() + 0.01);
  EXPECT_FALSE(cell.hold(kUp, 0.3).refused());

  Cell control;
  control.hold(kDown, 2.0);
  EXPECT_LT(control.lowest, limits.workspace.min_m.z() - 0.1);
}

Box tableBelow(double top_z) { return {"table", {-2, -2, top_z - 0.5}, {2, 2, top_z}}; }

TEST(Guard, KeepsTheFlangeOutOfKeepOutBoxes) {
  Cell probe;
  const double top = probe.z() - 0.1;
  MotionLimits limits = openLimits();
  limits.keep_out = {tableBelow(top)};
  Cell cell(limits);
  const GuardVerdict verdict = cell.hold(kDown, 2.0);
  EXPECT_EQ(verdict.rule, GuardRule::kKeepOut);
  EXPECT_NE(verdict.reason.find("'table'"), std::string::npos) << verdict.reason;
  EXPECT_GE(cell.lowest, top);
  EXPECT_LT(cell.lowest, top + 0.01);
  EXPECT_LE(largestAcceleration(cell.arm), 1.2 * (1 + 1e-6));

  Cell control;
  control.hold(kDown, 2.0);
  EXPECT_LT(control.lowest, top - 0.1);
}

TEST(Guard, KeepsTheBoardOutOfKeepOutBoxes) {
  Cell probe;
  probe.arm.state();
  probe.hold(kDown, 0.02);
  const double top = probe.corner_low - 0.1;
  MotionLimits limits = openLimits();
  limits.keep_out = {tableBelow(top)};
  Cell cell(limits);
  cell.guard->setBoard(kMount);
  EXPECT_EQ(cell.hold(kDown, 2.0).rule, GuardRule::kKeepOut);
  EXPECT_GE(cell.corner_low, top);
  EXPECT_GT(cell.lowest, top + 0.02);  // It was the board, not the flange.

  Cell control(limits);  // Not told of the board.
  control.hold(kDown, 2.0);
  EXPECT_LT(control.corner_low, top - 0.02);
}

// A thing that fits between the corners, in the middle of the plate.
TEST(Guard, KeepsTheMiddleOfTheBoardOutOfASmallBox) {
  Cell probe;
  const RobotState state = probe.arm.state();
  const Eigen::Vector3d middle = state.bMe * (kMount * Eigen::Vector3d::Zero());
  const Eigen::Vector3d towards = state.bMe.rotation() * kMount.rotation() * Eigen::Vector3d(0, 0, -1);
  MotionLimits limits = openLimits();
  const Eigen::Vector3d center = middle + 0.2 * towards;
  limits.keep_out = {
      {"post", center - Eigen::Vector3d::Constant(0.05), center + Eigen::Vector3d::Constant(0.05)}};
  const Twist<Base> ahead{0.2 * towards, {0, 0, 0}};
  const auto nearest = [&](Cell& cell) {
    return (cell.arm.state().bMe * (kMount * Eigen::Vector3d::Zero()) - center).norm();
  };
  Cell cell(limits);
  cell.guard->setBoard(kMount);
  cell.hold(ahead, 1.0);
  EXPECT_GT(nearest(cell), 0.05);
  Cell control;
  control.guard->setBoard(kMount);
  control.hold(ahead, 1.0);
  EXPECT_LT(nearest(control), 0.03);
}

TEST(Guard, KeepsASphereClearWhileTheMountIsUnknown) {
  Cell probe;
  const double top = probe.z() - 0.3;
  MotionLimits limits = openLimits();
  limits.keep_out = {tableBelow(top)};
  Cell cell(limits);
  cell.guard = std::make_unique<Guard>(cell.arm, cell.kinematics, cell.clock, limits, cell.board);
  const GuardVerdict verdict = cell.hold(kDown, 2.0);
  EXPECT_EQ(verdict.rule, GuardRule::kKeepOut) << verdict.reason;
  EXPECT_GE(cell.lowest, top + 0.2 - 1e-9);

  Cell control(limits);  // setBoard(nullopt): no board.
  control.hold(kDown, 2.0);
  EXPECT_LT(control.lowest, top + 0.1);
}

// An arm that was left inside a box gets out, but neither deeper nor sideways.
TEST(Guard, LetsTheArmOutOfABoxButNotDeeper) {
  Cell probe;
  MotionLimits limits = openLimits();
  limits.keep_out = {tableBelow(probe.z() + 0.03)};
  Cell cell(limits);
  const double before = cell.z();
  EXPECT_TRUE(cell.hold(kDown, 0.3).refused());
  EXPECT_TRUE(cell.hold({{0.1, 0, 0}, {0, 0, 0}}, 0.3).refused());
  EXPECT_NEAR(cell.z(), before, 1e-6);
  EXPECT_FALSE(cell.hold(kUp, 0.5).refused());
  EXPECT_GT(cell.z(), before + 0.05);
  cell.hold(kDown, 2.0);
  EXPECT_GE(cell.z(), before + 0.03);  // Outside now, and it stays so.
}

TEST(Guard, SaysWhyAPoseIsNotAllowed) {
  MotionLimits limits = openLimits();
  limits.keep_out = {{"camera", {0.3, 0.3, 0.3}, {0.4, 0.4, 0.4}}};
  Cell cell(limits);
  const Pose<Base, EndEffector> inside(Eigen::Matrix3d::Identity(), {0.35, 0.35, 0.35});
  ASSERT_TRUE(cell.guard->objection(inside));
  EXPECT_NE(cell.guard->objection(inside)->find("'camera'"), std::string::npos);
  EXPECT_FALSE(cell.guard->allows(Pose<Base, EndEffector>()));
  EXPECT_TRUE(cell.guard->allows(cell.arm.state().bMe));
  Eigen::VectorXd q = cell.arm.state().q;
  EXPECT_TRUE(cell.guard->allows(q));
  q[3] = 2 * kPi - 0.01;
  EXPECT_FALSE(cell.guard->allows(q));
}

TEST(Guard, RefusesLimitsThatAreNone) {
  const auto make = [](const MotionLimits& limits, const GuardOptions& options = {}) {
    Cell cell(limits, options);
  };
  EXPECT_NO_THROW(make(openLimits()));
  EXPECT_THROW(make(MotionLimits{}), std::invalid_argument);  // No workspace.
  MotionLimits limits = openLimits();
  limits.max_speed_mps = 0;
  EXPECT_THROW(make(limits), std::invalid_argument);
  limits = openLimits();
  limits.max_acceleration_mps2 = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(make(limits), std::invalid_argument);
  limits = openLimits();
  limits.keep_out = {{"inside out", {1, 1, 1}, {0, 2, 2}}};
  EXPECT_THROW(make(limits), std::invalid_argument);
  GuardOptions options;
  options.look_ahead = std::chrono::milliseconds(50);
  EXPECT_THROW(make(openLimits(), options), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::robot
