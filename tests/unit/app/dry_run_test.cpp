// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app_dry_run/dry_run.h"

#include <gtest/gtest.h>

#include "cells.h"
#include "errors.h"
#include "sim_truth.h"

namespace servocal::app {
namespace {

/// The one-camera cell, and a result that says the truth about it.
class DryRunOf : public testing::Test {
 protected:
  DryRunOf() {
    cell.coverage.cells_x = 4;
    cell.coverage.cells_y = 3;
    cell.coverage.max_views = 12;
    cell.coverage.revisit_views = 4;
    CameraResult camera;
    camera.camera = "cam1";
    camera.intrinsics.camera = truth.camera("cam1");
    camera.hand_eye.emplace();
    camera.hand_eye->camera_pose = truth.bMc("cam1").isometry();
    camera.hand_eye->board_pose = truth.eMo().isometry();
    result.cameras.push_back(camera);
  }

  CellConfig cell = test::oneCameraCell();
  sim::Cell simulation{cell, 1};
  sim::Truth truth{simulation};
  CalibrationResult result;
};

TEST_F(DryRunOf, AnUnknownCellIsWhatLiesAroundTheStartPose) {
  const DryRun plan = dryRun(cell, std::nullopt);
  ASSERT_EQ(plan.start.size(), 1u + 7u);
  for (const PlannedStop& stop : plan.start) EXPECT_EQ(stop.objection, "") << stop.what;
  ASSERT_EQ(plan.cameras.size(), 1u);
  EXPECT_TRUE(plan.cameras[0].stops.empty());
  test::expectPart(text(cell, plan), "where it stands is not known before a run");
  EXPECT_GT(plan.duration_s, 5.0);
}

TEST_F(DryRunOf, AKnownCellHasItsViewsPlannedAsTheRunWould) {
  const DryRun plan = dryRun(cell, result);
  ASSERT_EQ(plan.cameras.size(), 1u);
  const PlannedCamera& camera = plan.cameras[0];
  EXPECT_EQ(camera.unknown, "");
  EXPECT_EQ(camera.cells, 12);
  EXPECT_EQ(camera.cells_filled + camera.cells_out_of_reach, 12);
  EXPECT_GE(camera.cells_filled, 8);
  EXPECT_GE(camera.stops.size(), 15u);
  double before_s = 0.0;
  for (const PlannedStop& stop : camera.stops) {
    EXPECT_EQ(stop.objection, "") << stop.what;
    EXPECT_GE(stop.at_s, before_s);
    before_s = stop.at_s;
    // Where the arm goes the camera sees the board, all of it.
    const Pose<Color, Board> cMo = truth.bMc("cam1").inverse() * stop.bMe * truth.eMo();
    for (const Eigen::Vector3d& corner : cell.board.corners()) {
      const auto pixel = truth.camera("cam1").project(cMo * corner);
      ASSERT_TRUE(pixel && truth.camera("cam1").contains(*pixel)) << stop.what;
    }
  }
  EXPECT_DOUBLE_EQ(plan.duration_s, before_s);
}

TEST_F(DryRunOf, ACellThatGoesByInformationIsToldThatItsViewsFollowFromTheRun) {
  const std::string sentence = "planner goes by information";
  EXPECT_EQ(text(cell, dryRun(cell, result)).find(sentence), std::string::npos);
  cell.planner.choose_by = Planner::kInformation;
  test::expectPart(text(cell, dryRun(cell, result)), sentence);
}

TEST_F(DryRunOf, WhatIsInTheWayIsNamed) {
  const Eigen::Vector3d flange = truth.bMe().translation();
  cell.limits.keep_out.push_back(
      {"lamp", flange - Eigen::Vector3d::Constant(0.05), flange + Eigen::Vector3d::Constant(0.05)});
  const DryRun plan = dryRun(cell, std::nullopt);
  test::expectPart(plan.start.front().objection, "lamp");
  test::expectPart(text(cell, plan), "NOT DONE");
}

TEST_F(DryRunOf, TheNearestBodiesAreNamedWithTheirDistance) {
  // A wall beyond the board at the start pose.
  const Eigen::Vector3d board = (truth.bMe() * truth.eMo()).translation();
  cell.limits.keep_out = {
      {"wall", board + Eigen::Vector3d(0.25, -0.5, -0.5), board + Eigen::Vector3d(0.30, 0.5, 0.5)}};
  const DryRun plan = dryRun(cell, result);
  int near_the_wall = 0;
  for (const PlannedStop& stop : plan.cameras[0].stops) {
    if (stop.nearest != "board and keep-out box 'wall'") continue;
    ++near_the_wall;
    double pattern_m = 1.0;
    for (const Eigen::Vector3d& point : cell.board.patternOutline())
      pattern_m =
          std::min(pattern_m, cell.limits.keep_out[0].min_m.x() - (stop.bMe * truth.eMo() * point).x());
    EXPECT_LT(stop.clearance_m, pattern_m);          // The plate is wider and thicker than the pattern,
    EXPECT_GT(stop.clearance_m, pattern_m - 0.035);  // by 15 and at most 10 mm.
  }
  EXPECT_GT(near_the_wall, 0);
}

TEST_F(DryRunOf, TheSweepIsPlannedWithItsNarrowestPlace) {
  SearchSweep sweep;
  sweep.posture_q = cell.arm.start_q;
  sweep.from_rad = cell.arm.start_q[0];
  sweep.to_rad = cell.arm.start_q[0] - 0.6;
  cell.arm.search = sweep;
  const DryRun plan = dryRun(cell, std::nullopt);
  test::expectPart(plan.start.back().what, "takes 4 s");
  EXPECT_EQ(plan.start.back().objection, "");
}

}  // namespace
}  // namespace servocal::app
