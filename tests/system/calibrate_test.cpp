// SPDX-License-Identifier: GPL-3.0-or-later
// Whole runs in the simulated cell, judged by its truth.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "cells.h"
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

/// Each limit of the color stream was seen, and a step beyond it, where detection ended it, was not.
void expectTiltLimitsAreTried(const session::Session& session, const CameraResult& camera) {
  const std::map<std::string, Eigen::Vector3d> axes = {{"roll+", {0, 0, 1}},   {"pitch+", {1, 0, 0}},
                                                       {"yaw+", {0, 1, 0}},    {"roll-", {0, 0, -1}},
                                                       {"pitch-", {-1, 0, 0}}, {"yaw-", {0, -1, 0}}};
  const std::vector<Attempt> attempts = session.attempts();
  for (const TiltLimit& limit : camera.tilt_limits) {
    if (limit.stream != Stream::kColor) continue;
    SCOPED_TRACE(limit.direction + " " + limit.ended_by);
    const auto isTried = [&](double angle_rad, bool seen) {
      return std::any_of(attempts.begin(), attempts.end(), [&](const Attempt& attempt) {
        return attempt.stage == "tilt" && attempt.observation_id.has_value() == seen &&
               (attempt.cdMo.rotationVector() - angle_rad * axes.at(limit.direction)).norm() < 1e-6;
      });
    };
    EXPECT_TRUE(limit.limit_rad == 0.0 || isTried(limit.limit_rad, true));
    if (limit.ended_by != "detection") continue;
    EXPECT_TRUE(isTried(limit.limit_rad + 5 * kDegree, false));
    EXPECT_FALSE(isTried(limit.limit_rad + 5 * kDegree, true));
  }
}

TEST(Calibrate, DefaultCellIsCalibratedInAClosedLoop) {
  const test::TemporaryFolder folder;
  const test::Trial trial = test::runTrial(test::oneCameraCell(), 1, folder.path() / "session");
  expectGood(trial);

  // The recorded session gives the same answer as the live run.
  const auto session = session::Session::open(folder.path() / "session");
  procedure::SolveOptions options;
  options.robot_sigma_m = test::oneCameraCell().arm.accuracy_m;
  options.robot_sigma_rad = test::oneCameraCell().arm.accuracy_rad;
  const CalibrationResult again = procedure::solve(session.board(), session.observations(), options);
  ASSERT_EQ(again.cameras.size(), 1u);
  const auto& live = trial.result.cameras.front();
  expectTiltLimitsAreTried(session, live);
  const auto& replayed = again.cameras.front();
  EXPECT_LT((live.intrinsics.camera.parameters - replayed.intrinsics.camera.parameters).norm(), 1e-9);
  ASSERT_TRUE(replayed.hand_eye);
  EXPECT_LT((live.hand_eye->camera_pose.matrix() - replayed.hand_eye->camera_pose.matrix()).norm(), 1e-12);
}

double meanSizeM(const std::vector<test::PlaneGap>& gaps) {
  double sum_m = 0.0;
  for (const test::PlaneGap& gap : gaps) sum_m += std::abs(gap.distance_m) / static_cast<double>(gaps.size());
  return sum_m;
}

// The paper's cell: two Kinect v2 and a Kinect v1, nothing known but their data sheets. Limits are those of
// the worst seed; medians over seeds are in tests/bench/cell_bench.
TEST(Calibrate, ThreeRgbdCamerasInOneRun) {
  const test::TemporaryFolder folder;
  const test::Trial trial = test::runTrial(defaultCell(), 1, folder.path() / "session");
  EXPECT_TRUE(trial.result.goal_met);
  for (const std::string& missing : trial.result.missing) ADD_FAILURE() << missing;
  EXPECT_LE(trial.result.motion_time_s, 600.0);
  EXPECT_LE(trial.result.tilt_time_s, 240.0);
  ASSERT_EQ(trial.errors.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const test::CameraErrors& errors = trial.errors[i];
    SCOPED_TRACE(errors.camera);
    const bool v1 = errors.camera == "front";
    EXPECT_LT(errors.pose_m, v1 ? 0.005 : 0.003);
    EXPECT_LT(errors.pose_rad, (v1 ? 0.6 : 0.25) * kDegree);
    ASSERT_TRUE(errors.infrared_m && errors.depth_after_m);
    EXPECT_LT(*errors.infrared_m, 0.002);
    EXPECT_LT(*errors.infrared_rad, 0.3 * kDegree);
    EXPECT_LT(*errors.depth_after_m, v1 ? 0.004 : 0.003);
    EXPECT_GT(*errors.depth_before_m, 2 * *errors.depth_after_m);
    EXPECT_GT(trial.result.cameras[i].combined_views, 10);
    ASSERT_TRUE(trial.result.cameras[i].held_out);
    EXPECT_LT(trial.result.cameras[i].held_out->rms_m, 0.003);
  }

  // Two cameras of one run differ by about what each is off, and so do the clouds that they measure of a
  // plane.
  const auto pair =
      std::find_if(trial.pairs.begin(), trial.pairs.end(),
                   [](const test::CameraPairErrors& other) { return !other.corrected.empty(); });
  ASSERT_NE(pair, trial.pairs.end());
  EXPECT_LT(pair->staged.between_m, 2 * std::max(pair->staged.first_m, pair->staged.second_m));
  ASSERT_EQ(pair->raw.size(), 5u);
  ASSERT_EQ(pair->corrected.size(), 5u);
  EXPECT_LT(meanSizeM(pair->corrected), 0.002);
  EXPECT_GT(meanSizeM(pair->raw), 2 * meanSizeM(pair->corrected));
  // As programs use the result: lenses and poses of the joint estimate, on which the depth stands.
  ASSERT_EQ(pair->best.size(), 5u);
  EXPECT_LT(meanSizeM(pair->best), 0.0007);

  // Negative control: a camera 5 mm aside shows.
  CalibrationResult moved = trial.result;
  CameraResult& second =
      *std::find_if(moved.cameras.begin(), moved.cameras.end(),
                    [&](const CameraResult& camera) { return camera.camera == pair->second; });
  second.hand_eye->camera_pose.translation().x() -= 0.005;
  const auto gaps =
      test::planeGaps(moved, trial.plane_shots, pair->first, pair->second, test::Cloud::kCorrected);
  ASSERT_EQ(gaps.size(), 5u);
  for (std::size_t i = 0; i < gaps.size(); ++i)
    EXPECT_NEAR(gaps[i].distance_m - pair->corrected[i].distance_m, -0.005, 0.001);
}

// Seen in part, of another texture and with another limit of tilt: the same loop.
TEST(Calibrate, AnAprilGridServesAsWell) {
  CellConfig cell = test::oneCameraCell();
  cell.board = loadBoard(SERVOCAL_BOARDS "/aprilgrid_4x3.yaml");
  const test::TemporaryFolder folder;
  const test::Trial trial = test::runTrial(cell, 2, folder.path() / "session");
  expectGood(trial);
  const auto session = session::Session::open(folder.path() / "session");
  expectTiltLimitsAreTried(session, trial.result.cameras.front());
}

TEST(Calibrate, SaysSoWhenTheCameraDoesNotSeeTheBoard) {
  CellConfig cell = test::oneCameraCell();
  cell.simulation->cameras.front().look_at_m = {2.0, 0.0, 0.4};  // looks away
  const test::TemporaryFolder folder;
  const test::Trial trial = test::runTrial(cell, 1, folder.path() / "session");
  EXPECT_FALSE(trial.result.goal_met);
  ASSERT_EQ(trial.result.missing.size(), 1u);
  EXPECT_NE(trial.result.missing.front().find("does not see the board"), std::string::npos);
}

}  // namespace
}  // namespace servocal
