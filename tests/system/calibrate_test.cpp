// SPDX-License-Identifier: GPL-3.0-or-later
// Whole runs in the simulated cell, judged by its truth.
#include <gtest/gtest.h>

#include <cmath>

#include "servocal/procedure/solve.h"
#include "servocal/session/session.h"
#include "temporary_folder.h"
#include "trial.h"

namespace servocal {
namespace {

constexpr double kDegree = M_PI / 180.0;

/// The limits that every run must hold; medians and more seeds are in tests/bench/calibrate_bench.
void expectGood(const test::Trial& trial) {
  EXPECT_TRUE(trial.result.goal_met);
  for (const std::string& missing : trial.result.missing) ADD_FAILURE() << missing;
  EXPECT_GE(trial.reachable_cells, 0.7 * trial.cells);
  EXPECT_GE(trial.filled_reachable_cells, 0.95 * trial.reachable_cells);
  EXPECT_LE(trial.coverage_views, 40);
  EXPECT_LE(trial.result.motion_time_s, 300.0);
  EXPECT_LT(trial.camera_error_m, 0.008);
  EXPECT_LT(trial.camera_error_rad, 0.8 * kDegree);
  EXPECT_GT(trial.camera_error_m, 0.0);  // exactly zero would mean that somebody peeked
}

TEST(Calibrate, DefaultCellIsCalibratedInAClosedLoop) {
  const test::TemporaryFolder folder;
  const test::Trial trial = test::runTrial(defaultCell(), 1, folder.path() / "session");
  expectGood(trial);

  // The recorded session gives the same answer as the live run.
  const auto session = session::Session::open(folder.path() / "session");
  procedure::SolveOptions options;
  options.robot_sigma_m = defaultCell().arm.accuracy_m;
  options.robot_sigma_rad = defaultCell().arm.accuracy_rad;
  const CalibrationResult again = procedure::solve(session.board(), session.observations(), options);
  ASSERT_EQ(again.cameras.size(), 1u);
  const auto& live = trial.result.cameras.front();
  const auto& replayed = again.cameras.front();
  EXPECT_LT((live.intrinsics.camera.parameters - replayed.intrinsics.camera.parameters).norm(), 1e-9);
  ASSERT_TRUE(replayed.hand_eye);
  EXPECT_LT((live.hand_eye->camera_pose.matrix() - replayed.hand_eye->camera_pose.matrix()).norm(), 1e-12);
}

// Seen in part, of another texture and with another limit of tilt: the same loop.
TEST(Calibrate, AnAprilGridServesAsWell) {
  CellConfig cell = defaultCell();
  cell.board = loadBoard(SERVOCAL_BOARDS "/aprilgrid_4x3.yaml");
  const test::TemporaryFolder folder;
  expectGood(test::runTrial(cell, 2, folder.path() / "session"));
}

TEST(Calibrate, SaysSoWhenTheCameraDoesNotSeeTheBoard) {
  CellConfig cell = defaultCell();
  cell.simulation->cameras.front().look_at_m = {2.0, 0.0, 0.4};  // looks away
  const test::TemporaryFolder folder;
  const test::Trial trial = test::runTrial(cell, 1, folder.path() / "session");
  EXPECT_FALSE(trial.result.goal_met);
  ASSERT_EQ(trial.result.missing.size(), 1u);
  EXPECT_NE(trial.result.missing.front().find("does not see the board"), std::string::npos);
}

}  // namespace
}  // namespace servocal
