// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/coverage/coverage.h"

#include <gtest/gtest.h>

#include <cmath>

namespace servocal::coverage {
namespace {

constexpr int kWidth = 1920, kHeight = 1080;

Pose<Color, Board> boardAt(double z_m, const Eigen::Vector3d& turn_rad = Eigen::Vector3d::Zero()) {
  return Pose<Color, Board>::fromRotationVector(turn_rad, {0, 0, z_m});
}

Coverage makeCoverage(const ViewGoals& goals = {}) { return Coverage(CoverageConfig{}, {0, 0, kWidth, kHeight}, goals); }

TEST(Coverage, EveryPixelOfTheImageBelongsToOneCellAndNoneOutside) {
  const Coverage coverage = makeCoverage();
  EXPECT_EQ(coverage.cellAt({-0.5, -0.5}), 0);
  EXPECT_EQ(coverage.cellAt({kWidth - 0.51, kHeight - 0.51}), coverage.cells() - 1);
  EXPECT_FALSE(coverage.cellAt({-0.51, 10}));
  EXPECT_FALSE(coverage.cellAt({10, kHeight - 0.5}));
  EXPECT_FALSE(coverage.cellAt({std::nan(""), 10}));
  for (int cell = 0; cell < coverage.cells(); ++cell) EXPECT_EQ(coverage.cellAt(coverage.cellCenter(cell)), cell);
}

TEST(Coverage, ACellIsFilledByTwelveCornersAndNotByEleven) {
  Coverage coverage = makeCoverage();
  coverage.add(std::vector<Eigen::Vector2d>(11, {5, 5}), boardAt(0.4));
  EXPECT_FALSE(coverage.filled(0));
  EXPECT_EQ(coverage.missingCorners(std::vector<Eigen::Vector2d>(24, {5, 5})), 1);
  coverage.add({{5, 5}}, boardAt(0.4));
  EXPECT_TRUE(coverage.filled(0));
  EXPECT_EQ(coverage.missingCorners(std::vector<Eigen::Vector2d>(24, {5, 5})), 0);
  EXPECT_EQ(coverage.filledCells(), 1);
}

TEST(Coverage, OpenCellsGoFromTheCentreOutward) {
  const Coverage coverage = makeCoverage();
  const std::vector<int> open = coverage.openCells();
  ASSERT_EQ(static_cast<int>(open.size()), coverage.cells());
  const Eigen::Vector2d center(0.5 * (kWidth - 1), 0.5 * (kHeight - 1));
  for (std::size_t i = 1; i < open.size(); ++i) {
    EXPECT_LE((coverage.cellCenter(open[i - 1]) - center).norm(), (coverage.cellCenter(open[i]) - center).norm() + 1e-9);
  }
}

TEST(Coverage, GivingUpACellClosesItButDoesNotFillIt) {
  Coverage coverage = makeCoverage();
  coverage.giveUp(0);
  EXPECT_EQ(static_cast<int>(coverage.openCells().size()), coverage.cells() - 1);
  EXPECT_EQ(coverage.filledCells(), 0);
  EXPECT_EQ(coverage.missingCorners({{5, 5}}), 0);
}

// The arm gets there, the board is not seen there: nothing more to drive to, and yet not done.
TEST(Coverage, WhatIsSetAsideStaysMissing) {
  ViewGoals goals;
  goals.near_views = goals.views_per_tilt_bin = 0;
  goals.far_views = 1;
  Coverage coverage = makeCoverage(goals);
  for (int cell = 1; cell < coverage.cells(); ++cell) coverage.giveUp(cell);
  coverage.setAside(0);
  EXPECT_TRUE(coverage.openCells().empty());
  EXPECT_EQ(coverage.missingCorners({{5, 5}}), 0);
  EXPECT_FALSE(coverage.exhausted());  // A far view is missing.
  coverage.setMarginalsAside();
  EXPECT_EQ(coverage.missingMarginals(boardAt(0.8)), 0);
  EXPECT_TRUE(coverage.exhausted());
  coverage.giveUpMarginals();  // Set aside is not out of reach.
  EXPECT_FALSE(coverage.complete());
  ASSERT_EQ(coverage.missing().size(), 2u);
  EXPECT_NE(
      coverage.missing()[0].find("1 of 40 image cells are not filled, 1 given up because the board was lost"),
      std::string::npos)
      << coverage.missing()[0];
  EXPECT_NE(coverage.missing()[1].find("only 0 of 1 far views"), std::string::npos) << coverage.missing()[1];
  EXPECT_FALSE(coverage.summary().unreachable[0]);
  EXPECT_TRUE(coverage.summary().out_of_reach.empty());

  coverage.add(std::vector<Eigen::Vector2d>(12, {5, 5}),
               boardAt(0.8));  // Other cameras' stops may still show it.
  EXPECT_TRUE(coverage.complete());
}

TEST(Coverage, AGridOverARegionCountsNothingOutsideIt) {
  Coverage coverage(CoverageConfig{}, {100, 50, 800, 500});
  EXPECT_FALSE(coverage.cellAt({99.4, 300}));
  EXPECT_EQ(coverage.cellAt({99.5, 49.5}), 0);
  EXPECT_EQ(coverage.cellAt({899, 549}), coverage.cells() - 1);
  EXPECT_FALSE(coverage.cellAt({899.6, 300}));
  for (int cell = 0; cell < coverage.cells(); ++cell) EXPECT_EQ(coverage.cellAt(coverage.cellCenter(cell)), cell);
  EXPECT_NEAR((coverage.cellCenter(coverage.openCells().front()) - Eigen::Vector2d(499.5, 299.5)).norm(), 50.0, 1e-9);
}

TEST(Coverage, DistancesAndTiltsOutOfReachAreDoneAndRecorded) {
  ViewGoals goals;
  goals.near_views = 1;
  goals.far_views = 1;
  goals.views_per_tilt_bin = 1;
  Coverage coverage(CoverageConfig{}, {0, 0, kWidth, kHeight}, goals);
  for (int cell = 0; cell < coverage.cells(); ++cell) coverage.giveUp(cell);
  coverage.add({}, boardAt(0.4));
  ASSERT_FALSE(coverage.complete());
  ASSERT_EQ(coverage.missingMarginals(boardAt(0.8)), 1);
  coverage.giveUpMarginals();
  EXPECT_TRUE(coverage.complete());
  EXPECT_EQ(coverage.deficit(), 0);
  EXPECT_EQ(coverage.missingMarginals(boardAt(0.8)), 0);
  EXPECT_EQ(coverage.summary().out_of_reach,
            (std::vector<std::string>{"far views", "tilt pitch+", "tilt pitch-", "tilt yaw+", "tilt yaw-"}));
}

// Signs against OpenCV's and ViSP's right-handed turns: x right, y down, z forward.
TEST(TiltBinOf, FollowsTheRightHandRule) {
  EXPECT_EQ(tiltBinOf(boardAt(1)), TiltBin::kFrontal);
  EXPECT_EQ(tiltBinOf(boardAt(1, {0.1, -0.1, 0.7})), TiltBin::kFrontal);  // roll does not lean
  EXPECT_EQ(tiltBinOf(boardAt(1, {0.5, 0, 0})), TiltBin::kPitchPlus);
  EXPECT_EQ(tiltBinOf(boardAt(1, {-0.5, 0, 0})), TiltBin::kPitchMinus);
  EXPECT_EQ(tiltBinOf(boardAt(1, {0, 0.5, 0})), TiltBin::kYawPlus);
  EXPECT_EQ(tiltBinOf(boardAt(1, {0, -0.5, 0})), TiltBin::kYawMinus);
}

TEST(Coverage, IsCompleteOnlyWithCellsDistancesAndTilts) {
  ViewGoals goals;
  goals.near_views = goals.far_views = goals.views_per_tilt_bin = 1;
  Coverage coverage = makeCoverage(goals);
  for (int cell = 0; cell < coverage.cells(); ++cell) {
    coverage.add(std::vector<Eigen::Vector2d>(12, coverage.cellCenter(cell)), boardAt(0.4));
  }
  EXPECT_EQ(coverage.filledCells(), coverage.cells());
  EXPECT_FALSE(coverage.complete());  // no far view, no tilt
  EXPECT_EQ(coverage.missing().size(), 5u);
  EXPECT_EQ(coverage.missingMarginals(boardAt(0.4)), 0);
  EXPECT_EQ(coverage.missingMarginals(boardAt(0.6)), 1);
  EXPECT_EQ(coverage.missingMarginals(boardAt(0.6, {0.5, 0, 0})), 2);
  for (const double sign : {-1.0, 1.0}) {
    coverage.add({}, boardAt(0.6, {sign * 0.5, 0, 0}));
    coverage.add({}, boardAt(0.6, {0, sign * 0.5, 0}));
  }
  EXPECT_TRUE(coverage.complete());
  EXPECT_EQ(coverage.summary().far_views, 4);
}

TEST(Coverage, FarMeansAtLeastTwentyPercentFarther) {
  const Coverage coverage = makeCoverage();
  const double near = CoverageConfig{}.near_distance_m;
  EXPECT_FALSE(coverage.isFar(boardAt(1.199 * near)));
  EXPECT_TRUE(coverage.isFar(boardAt(1.201 * near)));
}

TEST(Coverage, RefusesAnEmptyImage) {
  EXPECT_THROW(Coverage(CoverageConfig{}, {0, 0, 0, 480}), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::coverage
