// SPDX-License-Identifier: GPL-3.0-or-later
// The same run in other cells and with other wishes: cameras that must be found first, a region of the image,
// a camera on the flange, another arm, clocks that are off.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "cells.h"
#include "default_sim.h"
#include "servocal/core/error.h"
#include "servocal/session/session.h"
#include "servocal/sim/cell.h"
#include "sim_truth.h"
#include "temporary_folder.h"
#include "trial.h"

namespace servocal {
namespace {

constexpr double kDegree = M_PI / 180.0;

test::Trial run(const CellConfig& cell) {
  const test::TemporaryFolder folder;
  return test::runTrial(cell, 3, folder.path() / "session");
}

bool names(const CalibrationResult& result, const std::string& part) {
  return std::any_of(result.missing.begin(), result.missing.end(),
                     [&](const std::string& sentence) { return sentence.find(part) != std::string::npos; });
}

/// So few views that a run is short; its coverage is not complete then.
CellConfig shortRun(CellConfig cell) {
  cell.coverage.max_views = 8;
  cell.coverage.revisit_views = 3;
  cell.coverage.check_views = 0;
  return cell;
}

void expectCalibrated(const test::Trial& trial) {
  for (const std::string& missing : trial.result.missing) std::cout << missing << '\n';
  ASSERT_EQ(trial.result.cameras.size(), 1u);
  ASSERT_TRUE(trial.result.cameras[0].hand_eye);
  ASSERT_EQ(trial.errors.size(), 1u);
  EXPECT_LT(trial.errors[0].pose_m, 0.004);
  EXPECT_LT(trial.errors[0].pose_rad, 0.4 * kDegree);
}

TEST(Modes, TheArmLooksForACameraThatDoesNotSeeTheBoardAtTheStart) {
  CellConfig cell = shortRun(test::oneCameraCell());
  const double seen_rad = cell.arm.start_q[0];
  cell.arm.start_q[0] -= 85 * kDegree;
  cell.limits.workspace.min_m.x() = -0.4;
  EXPECT_TRUE(names(run(cell).result, "does not see the board at the start"));
  cell.arm.search = SearchSweep{cell.arm.start_q, seen_rad - 50 * kDegree, seen_rad + 20 * kDegree};
  expectCalibrated(run(cell));
}

// The same camera to 1 px and 1 mm in fewer stops than coverage takes; and what is missing if it may not have
// them.
TEST(Modes, ViewsAreChosenByInformationUntilItIsGoodEnough) {
  CellConfig cell = test::oneCameraCell();
  cell.planner.choose_by = Planner::kInformation;
  cell.planner.projection_goal_px = 1.5;
  cell.planner.point_goal_m = 0.0015;
  const test::Trial trial = run(cell);
  expectCalibrated(trial);
  EXPECT_TRUE(trial.result.goal_met);
  ASSERT_TRUE(trial.result.joint);
  EXPECT_LE(trial.result.joint->cameras[0].at_range.worst_px, 1.5);
  EXPECT_LE(trial.result.cameras[0].coverage->cells_x, 4);
  EXPECT_LT(trial.result.observations, 90);

  cell.planner.projection_goal_px = 0.01;
  cell.planner.max_views = 3;
  const CalibrationResult short_of = run(cell).result;
  EXPECT_FALSE(short_of.goal_met);
  EXPECT_TRUE(names(short_of, "wanted are 0.01 px; the budget of 3 views"));
}

// An earlier run tells the mount and the tilt limits: neither probing motions nor a tilt search, and a mount
// that is not as it was is found all the same.
TEST(Modes, WhatAnEarlierRunFoundIsNotSoughtAgain) {
  const CellConfig cell = shortRun(test::oneCameraCell());
  sim::Cell simulation(cell, 3);
  const sim::Truth truth(simulation);
  CameraResult earlier;
  earlier.camera = cell.cameras[0].name;
  earlier.hand_eye.emplace();
  const Pose<EndEffector, Board> shifted(truth.eMo().rotation(),
                                         truth.eMo().translation() + Eigen::Vector3d(0.006, 0.0, 0.0));
  earlier.hand_eye->board_pose = shifted.isometry();
  for (const char* direction : {"roll+", "roll-", "pitch+", "pitch-", "yaw+", "yaw-"})
    earlier.tilt_limits.push_back({direction, 45 * kDegree, "cap", Stream::kColor});
  procedure::CalibrateOptions options;
  options.known.emplace();
  options.known->board = cell.board;
  options.known->cameras.push_back(earlier);

  const test::TemporaryFolder folder;
  const test::Trial trial = test::runTrial(cell, 3, folder.path() / "session", options);
  expectCalibrated(trial);
  EXPECT_EQ(trial.result.tilt_time_s, 0.0);
  ASSERT_EQ(trial.result.cameras[0].tilt_limits.size(), 6u);
  const auto session = session::Session::open(folder.path() / "session");
  for (const Observation& observation : session.observations()) {
    EXPECT_NE(observation.stage, "bootstrap");
    EXPECT_NE(observation.stage, "tilt");
  }
  const Eigen::Vector3d found = trial.result.cameras[0].hand_eye->board_pose.translation();
  EXPECT_LT((found - truth.eMo().translation()).norm(), 0.002);
  const auto log = session.events();
  EXPECT_TRUE(std::any_of(log.begin(), log.end(), [](const session::SessionEvent& line) {
    return line.message.find("not mounted as the earlier result says") != std::string::npos;
  }));

  options.known->board = BoardSpec{Checkerboard{9, 7, 0.02, true}};
  EXPECT_THROW(test::runTrial(cell, 3, folder.path() / "other", options), Error);
}

TEST(Modes, OnlyARegionOfTheImageNeedsToBeCovered) {
  CellConfig cell = test::oneCameraCell();
  cell.cameras[0].region = ImageRegion{640, 300, 640, 480};
  cell.coverage.cells_x = 4;
  cell.coverage.cells_y = 3;
  const test::Trial trial = run(cell);
  expectCalibrated(trial);
  EXPECT_TRUE(trial.result.goal_met);
  EXPECT_LT(trial.coverage_views, 20);  // The whole image takes 25 to 30.
}

TEST(Modes, ACameraOnTheFlangeWatchesABoardInTheCell) {
  const test::Trial trial = run(shortRun(loadCell(SERVOCAL_CELLS "/eye_in_hand.yaml")));
  expectCalibrated(trial);
  EXPECT_EQ(trial.result.cameras[0].hand_eye->mount, Mount::kFlange);
  EXPECT_TRUE(trial.result.cameras[0].depth);
}

TEST(Modes, AnArmOfSevenJointsByConfigurationAlone) {
  expectCalibrated(run(shortRun(loadCell(SERVOCAL_CELLS "/panda.yaml"))));
}

/// Five cameras: the paper's three, a color camera and a second Kinect v1. Intrinsics are given, so that each camera's turn
/// is a few views; cell_bench runs the whole procedure there (docs/results.md).
test::Trial runFiveCameras(const std::vector<std::string>& only) {
  CellConfig cell = loadCell(SERVOCAL_CELLS "/five_cameras.yaml");
  cell.coverage.revisit_views = 5;
  cell.coverage.check_views = 0;
  procedure::CalibrateOptions options;
  options.cameras = only;
  options.hand_eye_only = true;
  sim::Cell same(cell, 3);
  const sim::Truth truth(same);
  for (const CameraConfig& camera : cell.cameras) {
    options.given_intrinsics[{camera.name, Stream::kColor}] = truth.camera(camera.name);
  }
  const test::TemporaryFolder folder;
  return test::runTrial(cell, 3, folder.path() / "session", options);
}

void expectHandEyes(const test::Trial& trial, std::size_t cameras) {
  for (const std::string& missing : trial.result.missing) ADD_FAILURE() << missing;
  ASSERT_EQ(trial.errors.size(), cameras);
  for (const test::CameraErrors& errors : trial.errors) {
    SCOPED_TRACE(errors.camera);
    EXPECT_LT(errors.pose_m, 0.004);
    EXPECT_LT(errors.pose_rad, 0.4 * kDegree);
  }
}

TEST(Modes, AFourthAndAFifthCameraByConfigurationAlone) {
  const test::Trial trial = runFiveCameras({});
  expectHandEyes(trial, 5);
  EXPECT_EQ(trial.pairs.size(), 10u);
}

TEST(Modes, OneNamedCameraOfSeveral) {
  const test::Trial trial = runFiveCameras({"above"});
  expectHandEyes(trial, 1);
  EXPECT_EQ(trial.errors[0].camera, "above");
}

CellConfig withClock(FaultKind kind) {
  CellConfig cell = shortRun(test::oneCameraCell());
  SimulationFault fault;
  fault.kind = kind;
  fault.camera = cell.cameras[0].name;
  fault.offset_s = 0.08;
  cell.simulation->faults.push_back(fault);
  return cell;
}

// Stamps come from the camera's own clock, whatever that shows; what its data sheet has wrong is found by
// motion.
TEST(Modes, ACameraWhoseClockIsOffIsServedAlike) {
  const CellConfig cell = withClock(FaultKind::kClockOffset);
  const test::Trial trial = run(cell);
  expectCalibrated(trial);
  ASSERT_TRUE(trial.result.cameras[0].time_offset_s);
  const SimulatedCameraConfig& truth = cell.simulation->cameras[0];
  const double latency_s = 0.5 * truth.exposure_s + truth.latency_s;
  EXPECT_NEAR(*trial.result.cameras[0].time_offset_s, latency_s - cell.cameras[0].latency_s, 0.003);
}

TEST(Modes, ACameraWhoseImagesComeTooLateIsNamedAndCalibratedByWhatItSaw) {
  const test::Trial trial = run(withClock(FaultKind::kLateDelivery));
  expectCalibrated(trial);
  EXPECT_TRUE(names(trial.result, "too late for a servo"));
}

}  // namespace
}  // namespace servocal
