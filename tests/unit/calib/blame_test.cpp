// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/blame.h"

#include <gtest/gtest.h>

#include <iostream>

#include "joint_scene.h"

namespace servocal::calib {
namespace {

const test::Noise kUsual{0.2, 1e-4, 2.5e-4};

/// A cell of two cameras, and what happens to it.
struct Trial {
  test::Cell cell = test::makeCell(5, 2);
  std::vector<test::CellStop> stops;
  std::vector<Observation> observations;

  explicit Trial(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    stops = test::randomStops(cell, 60, random);
  }
  /// The stops from `first` on, in the cell as it is now.
  void observe(std::size_t first, std::size_t end, const test::Noise& noise = kUsual) {
    std::mt19937_64 random(100 + first);
    for (std::size_t i = first; i < end; ++i) {
      observations.push_back(test::observe(cell, stops[i], static_cast<std::int64_t>(i) + 1, noise, random));
    }
  }
  Blame blame() const {
    JointOptions options;
    options.robot_sigma_m = kUsual.robot_m;
    options.robot_sigma_rad = kUsual.robot_rad;
    const JointOutcome outcome = solveJoint(cell.board, observations, options);
    EXPECT_EQ(outcome.status, JointStatus::kSolved) << toString(outcome.status);
    if (!outcome.solution) return {};
    Blame out = findFaults(cell.board, observations, *outcome.solution);
    for (const Fault& fault : out.faults) std::cout << fault.significance << ": " << fault.sentence << '\n';
    return out;
  }
};

TEST(FindFaults, FindsNoneWhereThereAreNone) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Trial trial(seed);
    trial.observe(0, 60);
    const Blame blame = trial.blame();
    EXPECT_TRUE(blame.faults.empty()) << seed;
    ASSERT_EQ(blame.budgets.size(), 8u);
    EXPECT_NEAR(blame.budgets[0].found, 0.1, 0.03) << blame.budgets[0].part;
    EXPECT_NEAR(blame.budgets[2].found, 0.2, 0.02) << blame.budgets[2].part;
  }
}

TEST(FindFaults, NamesABoardThatSlipped) {
  Trial trial(11);
  trial.observe(0, 35);
  trial.cell.board_pose.translation() += Eigen::Vector3d(0.001, -0.0005, 0);
  trial.observe(35, 60);
  const Blame blame = trial.blame();
  ASSERT_FALSE(blame.faults.empty());
  EXPECT_EQ(blame.faults[0].kind, FaultKind::kBoardMoved);
  EXPECT_NEAR(static_cast<double>(*blame.faults[0].since), 36.0, 2.0);
  EXPECT_NEAR(blame.faults[0].moved_m, 0.00112, 0.0005);
}

// Ten millimetres: no robust solve takes both sides.
TEST(FindFaults, NamesALargeStepByWhatWasLeftOut) {
  Trial board(15);
  board.observe(0, 40);
  board.cell.board_pose.translation() += Eigen::Vector3d(0.008, -0.006, 0);
  board.observe(40, 60);
  const Blame by_board = board.blame();
  ASSERT_EQ(by_board.faults.size(), 1u);
  EXPECT_EQ(by_board.faults[0].kind, FaultKind::kBoardMoved);
  EXPECT_NEAR(static_cast<double>(*by_board.faults[0].since), 41.0, 3.0);

  Trial camera(16);
  camera.observe(0, 40);
  camera.cell.cameras[0].pose.translation() += Eigen::Vector3d(0.0, 0.01, 0.0);
  camera.observe(40, 60);
  const Blame by_camera = camera.blame();
  ASSERT_EQ(by_camera.faults.size(), 1u);
  EXPECT_EQ(by_camera.faults[0].kind, FaultKind::kCameraMoved);
  EXPECT_EQ(by_camera.faults[0].camera, camera.cell.cameras[0].name);
  EXPECT_NEAR(static_cast<double>(*by_camera.faults[0].since), 41.0, 6.0);
}

TEST(FindFaults, NamesACameraThatWasMoved) {
  Trial trial(12);
  trial.observe(0, 25);
  const Eigen::Isometry3d bump =
      Pose<Base, Base>::fromRotationVector({0, 0, 0.002}, {0.0008, -0.0005, 0.0004}).isometry();
  Eigen::Isometry3d& pose = trial.cell.cameras[2].pose;
  pose.linear() = bump.linear() * pose.linear();
  pose.translation() += bump.translation();
  trial.observe(25, 60);
  const Blame blame = trial.blame();
  ASSERT_FALSE(blame.faults.empty());
  EXPECT_EQ(blame.faults[0].kind, FaultKind::kCameraMoved);
  EXPECT_EQ(blame.faults[0].camera, trial.cell.cameras[2].name);
  EXPECT_NEAR(static_cast<double>(*blame.faults[0].since), 26.0, 4.0);
}

TEST(FindFaults, NamesABadArmAndAWrongBoard) {
  Trial arm(13);
  arm.observe(0, 60, {0.2, 6e-4, 1.5e-3});
  const Blame by_arm = arm.blame();
  ASSERT_FALSE(by_arm.faults.empty());
  for (const Fault& fault : by_arm.faults) EXPECT_EQ(fault.kind, FaultKind::kRobotNoise);

  Trial board(14);
  board.cell.shape = {0.985, 0.985, 0, -8e-4};
  board.observe(0, 60);
  const Blame by_board = board.blame();
  ASSERT_EQ(by_board.faults.size(), 2u);
  for (const Fault& fault : by_board.faults) {
    EXPECT_TRUE(fault.kind == FaultKind::kBoardSize || fault.kind == FaultKind::kBoardBowed);
  }
}

}  // namespace
}  // namespace servocal::calib
