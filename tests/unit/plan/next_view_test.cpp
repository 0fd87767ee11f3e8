// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/plan/next_view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "cells.h"
#include "fake_arm.h"

namespace servocal::plan {
namespace {

/// The default cell's arm in front of a camera that looks at it, everything known exactly.
struct PlanScene {
  explicit PlanScene(const MotionLimits& motion = test::oneCameraCell().limits) : limits(motion) {
    belief.camera = CameraModel::fromFieldOfView(1920, 1080, 1.466);
    Eigen::Matrix3d looking_back;  // camera at x = 1.15 looking along -x, y down
    looking_back << 0, 0, -1, 1, 0, 0, 0, -1, 0;
    belief.bMc = Pose<Base, Color>(looking_back, {1.15, 0.0, 0.4});
    belief.eMo = Pose<EndEffector, Board>::fromRotationVector({0, M_PI, 0}, {0, 0, 0.06});
    guard.setBoard(belief.eMo);
    options.distances_m = {0.45, 0.6, 0.7};
  }

  NextView next(const std::vector<Pose<Color, Board>>& tried = {}) const {
    return nextView(coverage, belief, cell.board, guard, cell.arm.start_q, cell.arm.start_q, tried, options);
  }
  std::vector<Eigen::Vector2d> cornersOf(const Pose<Color, Board>& cMo) const {
    std::vector<Eigen::Vector2d> pixels;
    for (const auto& corner : cell.board.corners()) pixels.push_back(*belief.camera.project(cMo * corner));
    return pixels;
  }

  CellConfig cell = test::oneCameraCell();
  MotionLimits limits;
  SimulatedClock clock;
  robot::Kinematics kinematics{cell.arm};
  test::FakeArm arm{kinematics, clock, cell.arm.start_q};
  robot::Guard guard{arm, kinematics, clock, limits, cell.board};
  coverage::Coverage coverage{cell.coverage, {0, 0, 1920, 1080}};
  Belief belief;
  PlanOptions options;
};

// At the image's edge a lean adds to the angle of the line of sight.
TEST(NextView, NoViewIsMoreObliqueThanTheDetectorBears) {
  PlanScene scene;
  scene.options.max_obliquity_rad = 0.5;
  std::vector<Pose<Color, Board>> tried;
  double largest = 0;
  for (int view = 0; view < 12; ++view) {
    const NextView next = scene.next(tried);
    for (const int cell : next.unreachable) scene.coverage.giveUp(cell);
    if (!next.view) break;
    const Pose<Color, Board>& cdMo = next.view->cdMo;
    const double cosine = cdMo.rotation().col(2).dot(cdMo.translation().normalized());
    largest = std::max(largest, std::acos(std::min(1.0, cosine)));
    scene.coverage.add(scene.cornersOf(cdMo), cdMo);
    tried.push_back(cdMo);
  }
  EXPECT_LE(largest, 0.5 + 1e-9);
  EXPECT_GT(largest, 0.3);  // There were oblique views to choose from.
}

TEST(NextView, FirstServesTheImageCentreWithAViewTheArmCanTake) {
  const PlanScene scene;
  const NextView next = scene.next();
  ASSERT_TRUE(next.view);
  EXPECT_EQ(next.view->cell, scene.coverage.openCells().front());
  EXPECT_TRUE(next.unreachable.empty());
  for (const auto& pixel : scene.cornersOf(next.view->cdMo)) EXPECT_TRUE(scene.belief.camera.contains(pixel));
  const auto q = scene.kinematics.inverse(next.view->bMe, scene.cell.arm.start_q);
  ASSERT_TRUE(q);
  EXPECT_TRUE(scene.guard.allows(*q));
  // The pose that is promised is the one that shows the board like that.
  const auto shown = scene.belief.bMc.inverse() * next.view->bMe * scene.belief.eMo;
  EXPECT_LT(distanceM(shown, next.view->cdMo), 1e-9);
}

// Driving exactly where it says must finish: every cell filled or out of reach, marginals met, in no more
// views than the cell file allows.
TEST(NextView, ARunOfPerfectDrivesCompletesTheCoverage) {
  PlanScene scene;
  Eigen::VectorXd q = scene.cell.arm.start_q;
  int views = 0;
  while (!scene.coverage.complete() && views < 60) {
    const NextView next = nextView(scene.coverage, scene.belief, scene.cell.board, scene.guard, q,
                                   scene.cell.arm.start_q, {}, scene.options);
    for (const int cell : next.unreachable) scene.coverage.giveUp(cell);
    if (!next.view) break;
    const auto pixels = scene.cornersOf(next.view->cdMo);
    EXPECT_GT(scene.coverage.missingCorners(pixels) + scene.coverage.missingMarginals(next.view->cdMo), 0);
    scene.coverage.add(pixels, next.view->cdMo);
    q = *scene.kinematics.inverse(next.view->bMe, q);
    ++views;
  }
  EXPECT_TRUE(scene.coverage.complete());
  EXPECT_LE(views, scene.cell.coverage.max_views);
  EXPECT_GE(scene.coverage.filledCells(), 28);
}

TEST(NextView, DoesNotProposeAgainWhatFailed) {
  const PlanScene scene;
  std::vector<Pose<Color, Board>> tried;
  for (int i = 0; i < 5; ++i) {
    const NextView next = scene.next(tried);
    ASSERT_TRUE(next.view);
    for (const auto& old : tried) {
      EXPECT_TRUE(distanceM(next.view->cdMo, old) >= 0.03 || angleRad(next.view->cdMo, old) >= 0.1);
    }
    tried.push_back(next.view->cdMo);
  }
}

// A box the arm may not leave: cells whose views lie outside are named, none of them is proposed.
TEST(NextView, NamesCellsOutOfReach) {
  MotionLimits limits = test::oneCameraCell().limits;
  limits.workspace.min_m.z() = 0.35;  // the lower part of the image cannot be reached
  PlanScene scene(limits);
  std::vector<int> unreachable;
  for (int i = 0; i < 60 && !scene.coverage.complete(); ++i) {
    const NextView next = scene.next();
    for (const int cell : next.unreachable) {
      unreachable.push_back(cell);
      scene.coverage.giveUp(cell);
    }
    if (!next.view) break;
    const auto q = scene.kinematics.inverse(next.view->bMe, scene.cell.arm.start_q);
    ASSERT_TRUE(q);
    EXPECT_TRUE(scene.guard.allows(*q));
    scene.coverage.add(scene.cornersOf(next.view->cdMo), next.view->cdMo);
  }
  const int bottom_left = scene.cell.coverage.cells_x * (scene.cell.coverage.cells_y - 1);
  EXPECT_NE(std::find(unreachable.begin(), unreachable.end(), bottom_left), unreachable.end());
  EXPECT_LT(unreachable.size(), 40u);
}

}  // namespace
}  // namespace servocal::plan
