// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "detection_frames.h"
#include "pictures.h"
#include "servocal/board/detector.h"

namespace servocal {
namespace {

using board::Detector;
using test::Picture;
using test::PictureOptions;
using test::renderPicture;
using test::rmsPx;

TEST(Mark, ATurnedBoardGivesTurnedIds) {
  const BoardSpec board;
  PictureOptions options;
  const Picture upright = renderPicture(board, options);
  options.roll_rad = M_PI;
  const Picture turned = renderPicture(board, options);
  const auto first = Detector(board).detect(upright.gray);
  const auto second = Detector(board).detect(turned.gray);
  ASSERT_TRUE(first && first->orientation_known && second && second->orientation_known);
  EXPECT_LT(rmsPx(*first, upright.corners), 0.1);
  EXPECT_LT(rmsPx(*second, turned.corners), 0.1);
  EXPECT_LT((first->corners.front().pixel - second->corners.back().pixel).norm(), 0.5);
}

TEST(Mark, HiddenMeansUndecided) {
  const BoardSpec board;
  for (const double gray : {30.0, 130.0, 220.0}) {
    PictureOptions options;
    options.covers.push_back({-0.5, -0.5, 0.93, 0.93, gray});
    const auto detection = Detector(board).detect(renderPicture(board, options).gray);
    EXPECT_FALSE(detection && detection->orientation_known) << gray;
  }
  // The square painted black: the board itself is whole, and found.
  PictureOptions options;
  options.covers.push_back({0.1, 0.1, 0.9, 0.9, options.black});
  const Picture picture = renderPicture(board, options);
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_FALSE(detection->orientation_known);
  EXPECT_LT(std::min(rmsPx(*detection, picture.corners), test::rmsTurnedPx(*detection, picture.corners)), 0.1);
}

// Something white on the opposite corner looks like a second mark; then nothing is known.
TEST(Mark, TwoMarksMeanUndecided) {
  const BoardSpec board;
  PictureOptions options;
  options.covers.push_back({6.2, 4.2, 6.8, 4.8, options.white});
  const auto detection = Detector(board).detect(renderPicture(board, options).gray);
  ASSERT_TRUE(detection);
  EXPECT_FALSE(detection->orientation_known);
}

TEST(Mark, AMirrorImageIsRefused) {
  PictureOptions options;
  options.mirror = true;
  EXPECT_FALSE(Detector(BoardSpec()).detect(renderPicture(BoardSpec(), options).gray));
}

// Odd by even squares: the colors alone tell, and all corner squares white is not this board.
TEST(Mark, ColorsTellWhereTheyAreNotSymmetric) {
  const BoardSpec board = test::plainBoard(8, 5);
  for (const double roll : {0.0, 1.5, 3.1, 4.7}) {
    PictureOptions options;
    options.roll_rad = roll;
    const Picture picture = renderPicture(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection) << roll;
    EXPECT_TRUE(detection->orientation_known) << roll;
    EXPECT_LT(rmsPx(*detection, picture.corners), 0.1) << roll;
  }
}

TEST(Mark, ASymmetricBoardIsNeverDecidedAndKeepsItsTurnWhileTracked) {
  const BoardSpec board = test::plainBoard(7, 5);
  PictureOptions options;
  Detector detector(board);
  const auto first = detector.detect(renderPicture(board, options).gray);
  ASSERT_TRUE(first);
  EXPECT_FALSE(first->orientation_known);
  Eigen::Vector2d last = first->corners[0].pixel;
  for (int frame = 0; frame < 12; ++frame) {
    options.roll_rad += 0.25;
    const auto detection = detector.track(renderPicture(board, options).gray);
    ASSERT_TRUE(detection) << frame;
    EXPECT_FALSE(detection->orientation_known);
    EXPECT_LT((detection->corners[0].pixel - last).norm(), 60.0) << frame;
    last = detection->corners[0].pixel;
  }
}

// Squares so blurred that a hollow one cannot be told from a solid one are squares still.
TEST(Mark, BlurMeansUndecidedNotAbsent) {
  const BoardSpec board;
  const cv::Size camera(640, 480);
  for (const int frame : {219, 266, 381}) {
    const Picture picture = renderPicture(board, test::boardFrame(12, board, camera, frame));
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection) << frame;
    EXPECT_LT(std::min(rmsPx(*detection, picture.corners), test::rmsTurnedPx(*detection, picture.corners)), 1.0) << frame;
  }
}

// Over seeds: right, or undecided; never wrong.
TEST(Mark, IsNeverWrong) {
  const BoardSpec board;
  int decided = 0, found = 0;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    std::mt19937 random(seed);
    PictureOptions options;
    options.seed = seed;
    options.square_px = test::picture::uniform(random, 8, 40);
    options.tilt_rad = test::picture::uniform(random, 0, 1.1);
    options.tilt_axis_rad = test::picture::uniform(random, 0, 6.28);
    options.roll_rad = test::picture::uniform(random, 0, 6.28);
    options.blur_px = test::picture::uniform(random, 0.5, 2.0);
    options.noise_gray = test::picture::uniform(random, 1, 6);
    const Picture picture = renderPicture(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    if (!detection) continue;
    ++found;
    if (!detection->orientation_known) continue;
    ++decided;
    EXPECT_LT(rmsPx(*detection, picture.corners), 1.0) << "seed " << seed;
  }
  EXPECT_GE(found, 50);
  EXPECT_GE(decided, 40);
}

}  // namespace
}  // namespace servocal
