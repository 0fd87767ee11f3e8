// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/board/detector.h"

#include <gtest/gtest.h>

#include "pictures.h"

namespace servocal {
namespace {

using board::Detector;
using test::Picture;
using test::PictureOptions;
using test::renderPicture;
using test::rmsPx;

constexpr double kDegree = M_PI / 180.0;

TEST(Detector, FindsEveryCornerOfTheDefaultBoard) {
  const BoardSpec board;
  const Picture picture = renderPicture(board, {});
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_TRUE(detection->orientation_known);
  ASSERT_EQ(detection->corners.size(), 24u);
  for (int id = 0; id < 24; ++id) EXPECT_EQ(detection->corners[id].id, id);
  EXPECT_LT(rmsPx(*detection, picture.corners), 0.05);
}

// Negative control: the measure used everywhere here sees a pixel, and half a turn.
TEST(Detector, MeasuresSeeAMistake) {
  const BoardSpec board;
  const Picture picture = renderPicture(board, {});
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_GT(rmsPx(*detection, picture.corners, {1.0, 0.0}), 0.9);
  EXPECT_GT(test::rmsTurnedPx(*detection, picture.corners), 50.0);
}

TEST(Detector, FindsTheBoardTurnedAndTiltedBlurredAndNoisy) {
  const BoardSpec board;
  int seed = 10;
  for (const double tilt_deg : {0.0, 30.0, 50.0, 60.0}) {
    for (const double roll_deg : {0.0, 80.0, 170.0, 260.0}) {
      PictureOptions options;
      options.tilt_rad = tilt_deg * kDegree;
      options.tilt_axis_rad = seed * 0.7;
      options.roll_rad = roll_deg * kDegree;
      options.blur_px = 0.6 + 0.1 * (seed % 7);
      options.noise_gray = 1.0 + seed % 4;
      options.light_gradient = 0.2;
      options.k1 = -0.1;
      options.seed = seed++;
      const Picture picture = renderPicture(board, options);
      const auto detection = Detector(board).detect(picture.gray);
      ASSERT_TRUE(detection) << "tilt " << tilt_deg << " roll " << roll_deg;
      EXPECT_TRUE(detection->orientation_known) << "tilt " << tilt_deg << " roll " << roll_deg;
      EXPECT_LT(rmsPx(*detection, picture.corners), 0.25) << "tilt " << tilt_deg << " roll " << roll_deg;
    }
  }
}

Eigen::Vector2d meanShift(const BoardDetection& detection, const Picture& picture) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Corner& corner : detection.corners) sum += corner.pixel - picture.corners[corner.id];
  return sum / static_cast<double>(detection.corners.size());
}

// A board lit unevenly along x: by a factor that grows by `lamp_per_px`, with a highlight on top that grows by
// `highlight_per_px` gray levels. All of it is blurred together.
void expectNoCornerMovedByLight(double black, double white, double lamp_per_px, double highlight_per_px) {
  const BoardSpec board;
  PictureOptions options;
  options.blur_px = 0.0;
  options.noise_gray = 0.0;
  options.square_px = 18.0;
  options.black = black, options.white = white;
  Picture picture = renderPicture(board, options);
  constexpr double kBlur_px = 2.0;
  cv::Mat lit(picture.gray.size(), CV_32FC1);
  for (int y = 0; y < lit.rows; ++y) {
    for (int x = 0; x < lit.cols; ++x) {
      const double along = x - options.centre_px.x();
      lit.at<float>(y, x) = static_cast<float>(std::max(0.1, 1.0 + lamp_per_px * along) *
                                               picture.gray.at<std::uint8_t>(y, x) + highlight_per_px * along);
    }
  }
  cv::GaussianBlur(lit, lit, cv::Size(), kBlur_px, kBlur_px, cv::BORDER_REPLICATE);
  lit.convertTo(picture.gray, CV_8UC1);
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_NEAR(meanShift(*detection, picture).x(), 0.0, 0.005);
  EXPECT_NEAR(meanShift(*detection, picture).y(), 0.0, 0.005);
}

// A lamp at the camera lights the near side of a tilted board more, by half a percent per pixel and more; what is lit unevenly is blurred
// as it is lit, which moves edges towards the dark by the blur's variance times that gradient: untreated by 0.024 px.
TEST(Detector, UnevenLightMovesNoCorner) { expectNoCornerMovedByLight(24, 120, 0.006, 0.0); }

// It adds to black and white alike, and so moves no edge.
TEST(Detector, AHighlightMovesNoCorner) { expectNoCornerMovedByLight(40, 130, 0.0, 0.6); }

// A third of the white, and nearly all of it.
TEST(Detector, SaturatedWhiteMovesNoCorner) {
  expectNoCornerMovedByLight(45, 225, 0.006, 0.0);
  expectNoCornerMovedByLight(100, 250, 0.006, 0.6);
}

TEST(Detector, EdgesBentByALensMoveNoCorner) {
  PictureOptions options;
  options.focal_px = 400.0;
  options.k1 = -0.25;
  options.square_px = 32.0;
  options.centre_px = {480.0, 330.0};
  options.roll_rad = 0.3;  // Off the pixel grid, whose aliasing is larger.
  options.noise_gray = 0.0;
  const BoardSpec board;
  const Picture picture = renderPicture(board, options);
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_LT(meanShift(*detection, picture).norm(), 0.003);  // Taken as straight: 0.008.
}

TEST(Detector, FindsSmallSquares) {
  const BoardSpec board;
  PictureOptions options;
  options.square_px = 8.5;
  options.blur_px = 0.7;
  const Picture picture = renderPicture(board, options);
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_LT(std::min(rmsPx(*detection, picture.corners), test::rmsTurnedPx(*detection, picture.corners)), 0.15);
}

// Rows about 5 px apart leave no edge to follow between two corners.
TEST(Detector, FindsForeshortenedSmallSquares) {
  const BoardSpec board;
  for (int k = 0; k < 8; ++k) {
    PictureOptions options;
    options.square_px = 13;
    options.tilt_rad = 65 * kDegree;
    options.tilt_axis_rad = 0.8 * k;
    options.roll_rad = 0.5 * k;
    options.seed = 40 + k;
    const Picture picture = renderPicture(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection) << k;
    EXPECT_LT(std::min(rmsPx(*detection, picture.corners), test::rmsTurnedPx(*detection, picture.corners)), 0.3) << k;
  }
}

// The corners under the strip could only be guessed.
TEST(Detector, RefusesABoardWithACoveredLine) {
  for (const double gray : {20.0, 90.0, 125.0, 160.0, 230.0}) {
    PictureOptions options;
    options.covers.push_back({-1, 0.7, 8, 1.3, gray});
    EXPECT_FALSE(Detector(BoardSpec()).detect(renderPicture(BoardSpec(), options).gray)) << "gray " << gray;
  }
}

TEST(Detector, FindsBoardsOfOtherSizesInBothOrdersOfTheirDimensions) {
  for (const auto& [x, y] : {std::pair(5, 7), std::pair(7, 5), std::pair(10, 7), std::pair(9, 12), std::pair(6, 5)}) {
    for (const double roll : {0.2, 1.8}) {
      const BoardSpec board = test::plainBoard(x, y);
      PictureOptions options;
      options.square_px = 24;
      options.roll_rad = roll;
      const Picture picture = renderPicture(board, options);
      const auto detection = Detector(board).detect(picture.gray);
      ASSERT_TRUE(detection) << x << " x " << y;
      EXPECT_EQ(detection->orientation_known, board.symmetry() == 1) << x << " x " << y;
      const double rms = rmsPx(*detection, picture.corners);
      const double turned = test::rmsTurnedPx(*detection, picture.corners);
      EXPECT_LT(board.symmetry() > 1 ? std::min(rms, turned) : rms, 0.1) << x << " x " << y;
    }
  }
}

TEST(Detector, TakesColorImages) {
  const BoardSpec board;
  const Picture picture = renderPicture(board, {});
  cv::Mat color;
  cv::cvtColor(picture.gray, color, cv::COLOR_GRAY2BGR);
  Detector detector(board);
  ASSERT_TRUE(detector.detect(color));
  EXPECT_TRUE(detector.track(color));
}

TEST(Detector, RefusesBoardsOfAnotherSize) {
  for (const auto& [x, y] : {std::pair(7, 6), std::pair(8, 5), std::pair(9, 7), std::pair(6, 5), std::pair(7, 4), std::pair(10, 7)}) {
    const BoardSpec wanted = test::plainBoard(7, 5);
    PictureOptions options;
    options.square_px = 25;
    const Picture picture = renderPicture(test::plainBoard(x, y), options);
    EXPECT_FALSE(Detector(wanted).detect(picture.gray)) << x << " x " << y;
  }
  // Negative control: the same picture shows a board to whoever looks for the right one.
  PictureOptions options;
  options.square_px = 25;
  EXPECT_TRUE(Detector(test::plainBoard(8, 5)).detect(renderPicture(test::plainBoard(8, 5), options).gray));
}

TEST(Detector, RefusesABoardOfWhichARowIsOutsideTheImage) {
  PictureOptions options;
  options.centre_px = {320, 60};  // Of 4 rows of corners at 30 px, the first is outside.
  options.square_px = 45;
  EXPECT_FALSE(Detector(BoardSpec()).detect(renderPicture(BoardSpec(), options).gray));
}

TEST(Detector, FindsNothingWhereNoBoardIs) {
  for (unsigned seed = 1; seed <= 12; ++seed) {
    PictureOptions options;
    options.board = false;
    options.seed = seed;
    options.noise_gray = seed % 3 == 0 ? 25 : 3;
    EXPECT_FALSE(Detector(BoardSpec()).detect(renderPicture(BoardSpec(), options).gray)) << "seed " << seed;
    EXPECT_FALSE(Detector(test::plainBoard(7, 5)).detect(renderPicture(BoardSpec(), options).gray)) << "seed " << seed;
  }
  EXPECT_FALSE(Detector(BoardSpec()).detect(cv::Mat(480, 640, CV_8UC1, cv::Scalar(90))));
  EXPECT_FALSE(Detector(BoardSpec()).detect(cv::Mat(5, 7, CV_8UC1, cv::Scalar(90))));
}

// Between the dots of a fine sheet a lattice of saddles looks like a board set on edge.
TEST(Detector, APerforatedSheetIsNoBoard) {
  for (const double pitch_px : {5.6, 6.0, 7.0, 8.0, 9.0}) {
    for (const double blur_px : {0.6, 1.0}) {
      PictureOptions sheet;
      sheet.board = false;
      sheet.clutter = false;
      cv::Mat gray(480, 640, CV_8UC1, cv::Scalar(150));
      // As many rows and columns as hold the board once and nothing more, turned by 45 degrees.
      constexpr int kShift = 4;
      for (int row = 0; row < 7; ++row) {
        for (int column = 0; column < 9; ++column) {
          const cv::Point centre(std::lround((200 + pitch_px * column) * (1 << kShift)),
                                 std::lround((150 + pitch_px * row) * (1 << kShift)));
          cv::circle(gray, centre, std::lround(pitch_px / 3 * (1 << kShift)), cv::Scalar(20), cv::FILLED, cv::LINE_AA, kShift);
        }
      }
      cv::GaussianBlur(gray, gray, cv::Size(), blur_px);
      for (const BoardSpec& board : {BoardSpec(), test::plainBoard(7, 5), test::plainBoard(6, 5), test::plainBoard(5, 4)})
        EXPECT_FALSE(Detector(board).detect(gray)) << pitch_px << " px, " << board.describe();
    }
  }
}

// What a fine texture imitates may be small; the board beside it is not.
TEST(Detector, TakesTheLargerOfTwoBoards) {
  const BoardSpec board = test::plainBoard(8, 5);
  PictureOptions options;
  options.clutter = false;
  options.centre_px = {480, 330};
  options.square_px = 24;
  Picture large = renderPicture(board, options);
  options.centre_px = {120, 80};
  options.square_px = 5;
  options.blur_px = 0.6;
  const Picture small = renderPicture(board, options);
  ASSERT_TRUE(Detector(board).detect(small.gray));
  const cv::Rect corner(0, 0, 240, 160);
  small.gray(corner).copyTo(large.gray(corner));
  const auto detection = Detector(board).detect(large.gray);
  ASSERT_TRUE(detection);
  EXPECT_LT(rmsPx(*detection, large.corners), 0.1);
}

TEST(Detector, TracksAMovingBoardAndForgetsIt) {
  const BoardSpec board;
  Detector detector(board);
  PictureOptions options;
  EXPECT_FALSE(detector.track(renderPicture(board, options).gray)) << "nothing to track yet";
  ASSERT_TRUE(detector.detect(renderPicture(board, options).gray));
  for (int frame = 1; frame <= 5; ++frame) {
    options.centre_px.x() += 30;
    options.centre_px.y() -= 15;
    options.roll_rad += 0.03;
    options.seed = frame;
    const Picture picture = renderPicture(board, options);
    const auto detection = detector.track(picture.gray);
    ASSERT_TRUE(detection) << "frame " << frame;
    EXPECT_TRUE(detection->orientation_known);
    EXPECT_LT(rmsPx(*detection, picture.corners), 0.1);
  }
  options.centre_px = {150, 330};
  EXPECT_FALSE(detector.track(renderPicture(board, options).gray)) << "it only looks nearby";
  EXPECT_TRUE(detector.detect(renderPicture(board, options).gray));
  detector.reset();
  EXPECT_FALSE(detector.track(renderPicture(board, options).gray));
}

// Claimed sigmas against true errors, over blur, noise, tilt and size.
TEST(Detector, CovarianceAgreesWithTheSpread) {
  const BoardSpec board;
  double sum = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  int count = 0;
  for (int k = 0; k < 30; ++k) {
    PictureOptions options;
    options.square_px = 14 + 1.3 * k;
    options.tilt_rad = (k % 6) * 10 * kDegree;
    options.tilt_axis_rad = k;
    options.roll_rad = 0.37 * k;
    options.blur_px = 0.6 + 0.03 * k;
    options.noise_gray = 2 + k % 4;
    options.clutter = false;
    options.seed = 100 + k;
    const Picture picture = renderPicture(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection && detection->orientation_known) << k;
    for (const Corner& corner : detection->corners) {
      const Eigen::Vector2d error = corner.pixel - picture.corners[corner.id];
      sum += corner.covariance_px2.llt().matrixL().solve(error).squaredNorm();
      mean += error;
      count += 2;
    }
  }
  const double z_std = std::sqrt(sum / count);
  EXPECT_GT(z_std, 0.8);
  EXPECT_LT(z_std, 1.25);
  EXPECT_LT((2 * mean / count).norm(), 0.01) << "bias, px";
}

TEST(Detector, RefusesMisuse) {
  EXPECT_THROW(Detector(test::plainBoard(2, 5)), std::invalid_argument);
  BoardSpec even;
  std::get<Checkerboard>(even.pattern).squares_x = 8;
  EXPECT_THROW(Detector{even}, std::invalid_argument);
  EXPECT_THROW(Detector(BoardSpec()).detect(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(Detector(BoardSpec()).detect(cv::Mat(480, 640, CV_32FC1)), std::invalid_argument);
}

}  // namespace
}  // namespace servocal
