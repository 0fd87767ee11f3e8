// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "servocal/board/detector.h"
#include "tag_pictures.h"

namespace servocal {
namespace {

using board::Detector;
using test::Picture;
using test::PictureOptions;
using test::renderCharuco;
using test::renderCircles;
using test::rmsPx;

constexpr double kDegree = M_PI / 180.0;

BoardSpec circles(int x, int y, bool asymmetric, double bigger = 1.0) {
  CircleGrid grid;
  grid.circles_x = x;
  grid.circles_y = y;
  grid.asymmetric = asymmetric;
  grid.bigger_corner_ratio = bigger;
  if (asymmetric) grid.diameter_m = 0.35 * grid.spacing_m;
  BoardSpec board{grid};
  board.margin_m = 0.025;  // Discs need white around them.
  return board;
}

/// Sums of squared error over claimed sigma, and of errors.
struct Spread {
  double squares = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  void add(const BoardDetection& detection, const std::vector<Eigen::Vector2d>& truth) {
    for (const Corner& corner : detection.corners) {
      const Eigen::Vector2d error = corner.pixel - truth[corner.id];
      squares += corner.covariance_px2.llt().matrixL().solve(error).squaredNorm();
      sum += error;
      count += 2;
    }
  }
  double zStd() const { return std::sqrt(squares / count); }
  double biasPx() const { return (2 * sum / count).norm(); }
};

PictureOptions hardOptions(int k) {
  PictureOptions options;
  options.tilt_rad = (k % 5) * 10 * kDegree;
  options.tilt_axis_rad = k;
  options.roll_rad = 0.2 + 0.11 * (k % 9);
  options.blur_px = 0.6 + 0.04 * k;
  options.noise_gray = 2 + k % 4;
  options.seed = 100 + k;
  return options;
}

TEST(Charuco, FindsEveryCornerWithEitherFirstSquare) {
  for (const bool white : {false, true}) {
    for (const int rows : {6, 7}) {
      Charuco charuco;
      charuco.squares_y = rows;
      charuco.first_square_white = white;
      const BoardSpec board{charuco};
      for (const double roll_deg : {0.0, 70.0, 180.0}) {
        PictureOptions options;
        options.square_px = 44;
        options.roll_rad = roll_deg * kDegree;
        const Picture picture = renderCharuco(board, options);
        const auto detection = Detector(board).detect(picture.gray);
        ASSERT_TRUE(detection) << white << ' ' << rows << ' ' << roll_deg;
        EXPECT_TRUE(detection->orientation_known);
        EXPECT_EQ(static_cast<int>(detection->corners.size()), board.cornerCount());
        EXPECT_LT(rmsPx(*detection, picture.corners), 0.05) << white << ' ' << rows << ' ' << roll_deg;
      }
    }
  }
}

TEST(Charuco, ReportsWhatIsSeen) {
  const BoardSpec board{Charuco()};
  PictureOptions options;
  options.square_px = 48;
  options.centre_px = {560, 330};
  options.covers.push_back({2.5, 2.5, 4.5, 4.5, 120});
  const Picture picture = renderCharuco(board, options);
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_GT(detection->corners.size(), 15u);
  EXPECT_LT(detection->corners.size(), 45u);
  // Corners 2 and 3 of the rows 2 and 3 are behind the cover.
  for (const Corner& corner : detection->corners)
    EXPECT_FALSE((corner.id % 8 == 2 || corner.id % 8 == 3) && (corner.id / 8 == 2 || corner.id / 8 == 3));
  EXPECT_LT(rmsPx(*detection, picture.corners), 0.08);
}

TEST(Charuco, CovarianceAgreesWithTheSpread) {
  const BoardSpec board{Charuco()};
  Spread spread;
  for (int k = 0; k < 16; ++k) {
    PictureOptions options = hardOptions(k);
    options.square_px = 30 + 1.2 * k;
    const Picture picture = renderCharuco(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection) << k;
    spread.add(*detection, picture.corners);
  }
  EXPECT_GT(spread.count, 16 * 2 * 30);
  EXPECT_GT(spread.zStd(), 0.8);
  EXPECT_LT(spread.zStd(), 1.25);
  EXPECT_LT(spread.biasPx(), 0.01);
}

TEST(Circles, TheBiggerDiscDecidesTheNumbering) {
  for (const auto& board : {circles(7, 5, false, 1.4), circles(6, 6, false, 1.4)}) {
    for (const double roll_deg : {0.0, 95.0, 185.0, 275.0}) {
      PictureOptions options;
      options.square_px = 42;
      options.roll_rad = roll_deg * kDegree;
      options.tilt_rad = 0.35;
      const Picture picture = renderCircles(board, options);
      const auto detection = Detector(board).detect(picture.gray);
      ASSERT_TRUE(detection) << roll_deg;
      EXPECT_TRUE(detection->orientation_known);
      EXPECT_LT(rmsPx(*detection, picture.corners), 0.06) << roll_deg;
      // Negative control: a board without the mark is not this one.
      BoardSpec plain = board;
      std::get<CircleGrid>(plain.pattern).bigger_corner_ratio = 1.0;
      EXPECT_FALSE(Detector(board).detect(renderCircles(plain, options).gray)) << roll_deg;
    }
  }
}

TEST(Circles, AsymmetricRowsAreNumberedAsTheBoardHasThem) {
  for (const double roll_deg : {0.0, 95.0, 185.0, 275.0}) {
    PictureOptions options;
    options.square_px = 50;
    options.roll_rad = roll_deg * kDegree;
    const BoardSpec board = circles(4, 7, true);
    const Picture picture = renderCircles(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection) << roll_deg;
    EXPECT_TRUE(detection->orientation_known);
    EXPECT_LT(rmsPx(*detection, picture.corners), 0.06) << roll_deg;
  }
}

TEST(Circles, AMirrorImageAndABoardlessImageAreRefused) {
  PictureOptions options;
  options.square_px = 42;
  options.mirror = true;
  const BoardSpec board = circles(7, 5, false, 1.4);
  EXPECT_FALSE(Detector(board).detect(renderCircles(board, options).gray));
  options.board = false;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    options.seed = seed;
    EXPECT_FALSE(Detector(board).detect(renderCircles(board, options).gray)) << seed;
  }
}

// The centre of the ellipse is not where the centre of the disc is seen: with large tilted discs the
// difference is several times the noise, and a correction with the wrong sign would double it.
TEST(Circles, CovarianceAgreesWithTheSpreadAndPerspectiveIsTakenOut) {
  Spread spread;
  for (int k = 0; k < 16; ++k) {
    const BoardSpec board = k % 2 == 0 ? circles(7, 5, false, 1.4) : circles(4, 7, true);
    PictureOptions options = hardOptions(k);
    options.square_px = k % 2 == 0 ? 30 + k : 50 + k;
    const Picture picture = renderCircles(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection && detection->orientation_known) << k;
    spread.add(*detection, picture.corners);
  }
  EXPECT_GT(spread.zStd(), 0.8);
  EXPECT_LT(spread.zStd(), 1.25);
  EXPECT_LT(spread.biasPx(), 0.01);
}

TEST(Circles, TracksAMovingBoard) {
  const BoardSpec board = circles(7, 5, false);
  Detector detector(board);
  PictureOptions options;
  options.square_px = 36;
  const auto first = detector.detect(renderCircles(board, options).gray);
  ASSERT_TRUE(first);
  Eigen::Vector2d last = first->corners[0].pixel;
  for (int frame = 1; frame <= 5; ++frame) {
    options.centre_px.x() += 20;
    options.roll_rad += 0.25;
    const Picture picture = renderCircles(board, options);
    const auto detection = detector.track(picture.gray);
    ASSERT_TRUE(detection) << frame;
    EXPECT_LT((detection->corners[0].pixel - last).norm(), 80.0) << "the numbering goes on";
    last = detection->corners[0].pixel;
  }
}

}  // namespace
}  // namespace servocal
