// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "servocal/board/detector.h"
#include "tag_pictures.h"

namespace servocal {
namespace {

using board::Detector;
using test::Picture;
using test::renderTags;
using test::rmsPx;
using test::TagPictureOptions;

constexpr double kDegree = M_PI / 180.0;

BoardSpec aprilGrid(int tags_x = 4, int tags_y = 3, int border_bits = 1) {
  TagGrid grid;
  grid.tags_x = tags_x;
  grid.tags_y = tags_y;
  grid.border_bits = border_bits;
  return BoardSpec{grid};
}

TagPictureOptions tagsOf(double side_px) {
  TagPictureOptions options;
  options.square_px = side_px;
  return options;
}

TEST(TagGrid, FindsEveryTagWithItsCornersInOrder) {
  for (const int border : {1, 2}) {
    for (const double roll_deg : {0.0, 90.0, 200.0}) {
      const BoardSpec board = aprilGrid(4, 3, border);
      TagPictureOptions options = tagsOf(60);
      options.roll_rad = roll_deg * kDegree;
      const Picture picture = renderTags(board, options);
      const auto detection = Detector(board).detect(picture.gray);
      ASSERT_TRUE(detection) << border << ' ' << roll_deg;
      EXPECT_TRUE(detection->orientation_known);
      ASSERT_EQ(detection->corners.size(), 48u) << border << ' ' << roll_deg;
      for (int id = 0; id < 48; ++id) EXPECT_EQ(detection->corners[id].id, id);
      EXPECT_LT(rmsPx(*detection, picture.corners), 0.05) << border << ' ' << roll_deg;
    }
  }
}

// Codes may count from either end, and not from zero.
TEST(TagGrid, KnowsWhereWhichCodeIs) {
  for (const bool from_below : {true, false}) {
    BoardSpec board = aprilGrid();
    std::get<TagGrid>(board.pattern).first_id = 100;
    std::get<TagGrid>(board.pattern).first_row_is_lowest = from_below;
    const Picture picture = renderTags(board, tagsOf(50));
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection);
    EXPECT_LT(rmsPx(*detection, picture.corners), 0.05);
    // Negative control: whoever takes it for the other board has every tag in a wrong place.
    std::get<TagGrid>(board.pattern).first_row_is_lowest = !from_below;
    const auto mistaken = Detector(board).detect(picture.gray);
    EXPECT_FALSE(mistaken) << "tags upright in rows that run upside down";
  }
}

// Kalibr prints squares that touch the tags' corners, which joins the tags into one black shape.
TEST(TagGrid, FindsTagsJoinedBySquaresAtTheirCorners) {
  const BoardSpec board = aprilGrid(6, 6, 2);
  TagPictureOptions options = tagsOf(38);
  options.kalibr_squares = true;
  options.roll_rad = 0.5;
  options.tilt_rad = 0.4;
  options.blur_px = 1.0;
  const Picture picture = renderTags(board, options);
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_EQ(detection->corners.size(), 144u);
  EXPECT_LT(rmsPx(*detection, picture.corners), 0.06);
}

TEST(TagGrid, ReportsWhatIsSeenOfABoardThatLeavesTheImage) {
  const BoardSpec board = aprilGrid(6, 6);
  TagPictureOptions options = tagsOf(60);
  options.centre_px = {600, 400};
  const Picture picture = renderTags(board, options);
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_GT(detection->corners.size(), 4 * 6u);
  EXPECT_LT(detection->corners.size(), 4 * 36u);
  EXPECT_LT(rmsPx(*detection, picture.corners), 0.05);
  for (std::size_t k = 0; k < detection->corners.size(); ++k) {
    EXPECT_EQ(detection->corners[k].id % 4, static_cast<int>(k % 4)) << "whole tags only";
    EXPECT_TRUE(k == 0 || detection->corners[k - 1].id < detection->corners[k].id);
  }
}

TEST(TagGrid, IgnoresForeignAndMisplacedTags) {
  const BoardSpec board = aprilGrid();
  TagPictureOptions options = tagsOf(55);
  options.codes = {{2, 400}, {5, board.as<TagGrid>()->code(6)}, {11, board.as<TagGrid>()->code(0) + 60}};
  const Picture picture = renderTags(board, options);
  const auto detection = Detector(board).detect(picture.gray);
  ASSERT_TRUE(detection);
  // Places 5 and 6 show one code; it is known by its neighbors which of them is right.
  EXPECT_EQ(detection->corners.size(), 4 * 9u);
  for (const Corner& corner : detection->corners)
    EXPECT_TRUE(corner.id / 4 != 2 && corner.id / 4 != 5 && corner.id / 4 != 11);
  EXPECT_LT(rmsPx(*detection, picture.corners), 0.05);

  // Two tags that changed places: both codes belong to the board, neither is where it should be.
  options.codes = {{0, board.as<TagGrid>()->code(7)}, {7, board.as<TagGrid>()->code(0)}};
  const auto swapped = Detector(board).detect(renderTags(board, options).gray);
  ASSERT_TRUE(swapped);
  EXPECT_EQ(swapped->corners.size(), 4 * 10u);
  EXPECT_LT(rmsPx(*swapped, picture.corners), 0.05);
}

TEST(TagGrid, FindsNothingWhereTooLittleIs) {
  const BoardSpec board = aprilGrid();
  for (unsigned seed = 1; seed <= 8; ++seed) {
    TagPictureOptions options;
    options.board = false;
    options.seed = seed;
    EXPECT_FALSE(Detector(board).detect(renderTags(board, options).gray)) << "seed " << seed;
  }
  EXPECT_FALSE(Detector(board).detect(cv::Mat(480, 640, CV_8UC1, cv::Scalar(90))));
  EXPECT_FALSE(Detector(board).detect(cv::Mat(5, 7, CV_8UC1, cv::Scalar(90))));
  // One tag of many says nothing about the others.
  TagPictureOptions options = tagsOf(60);
  for (int place = 1; place < 12; ++place) options.codes[place] = 300 + place;
  EXPECT_FALSE(Detector(board).detect(renderTags(board, options).gray));
  // Of a board of one it says all.
  const BoardSpec single = aprilGrid(1, 1);
  const Picture picture = renderTags(single, tagsOf(60));
  const auto detection = Detector(single).detect(picture.gray);
  ASSERT_TRUE(detection);
  EXPECT_LT(rmsPx(*detection, picture.corners), 0.05);
}

TEST(TagGrid, AMirrorImageIsRefused) {
  TagPictureOptions options = tagsOf(60);
  options.mirror = true;
  EXPECT_FALSE(Detector(aprilGrid()).detect(renderTags(aprilGrid(), options).gray));
}

TEST(TagGrid, TracksAMovingBoardAndForgetsIt) {
  const BoardSpec board = aprilGrid();
  Detector detector(board);
  TagPictureOptions options = tagsOf(45);
  options.centre_px = {250, 300};
  EXPECT_FALSE(detector.track(renderTags(board, options).gray)) << "nothing to track yet";
  ASSERT_TRUE(detector.detect(renderTags(board, options).gray));
  for (int frame = 1; frame <= 5; ++frame) {
    options.centre_px.x() += 25;
    options.centre_px.y() -= 15;
    options.roll_rad += 0.03;
    options.seed = frame;
    const Picture picture = renderTags(board, options);
    const auto detection = detector.track(picture.gray);
    ASSERT_TRUE(detection) << "frame " << frame;
    EXPECT_EQ(detection->corners.size(), 48u) << "frame " << frame;
    EXPECT_LT(rmsPx(*detection, picture.corners), 0.06);
  }
  detector.reset();
  EXPECT_FALSE(detector.track(renderTags(board, options).gray));
}

// Claimed sigmas against true errors, over blur, noise, tilt and size; and no bias, which half a pixel
// of convention would be.
TEST(TagGrid, CovarianceAgreesWithTheSpread) {
  double sum = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  int count = 0;
  for (int k = 0; k < 24; ++k) {
    const BoardSpec board = aprilGrid(4, 3, 1 + k % 2);
    TagPictureOptions options = tagsOf(24 + 2.5 * k);
    options.tilt_rad = (k % 5) * 10 * kDegree;
    options.tilt_axis_rad = k;
    options.roll_rad = 0.37 * k;
    options.blur_px = 0.6 + 0.03 * k;
    options.noise_gray = 2 + k % 4;
    options.seed = 100 + k;
    const Picture picture = renderTags(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection) << k;
    for (const Corner& corner : detection->corners) {
      const Eigen::Vector2d error = corner.pixel - picture.corners[corner.id];
      sum += corner.covariance_px2.llt().matrixL().solve(error).squaredNorm();
      mean += error;
      count += 2;
    }
  }
  const double z_std = std::sqrt(sum / count);
  EXPECT_GT(count, 2 * 24 * 40);
  EXPECT_GT(z_std, 0.8);
  EXPECT_LT(z_std, 1.25);
  EXPECT_LT((2 * mean / count).norm(), 0.01) << "bias, px";
}

// A lamp's reflection brightens one end of a side and may exceed what the camera can show. Neither turns
// the side by much: with light taken as constant along it, z is 7 and 8 here.
TEST(TagGrid, AHighlightMovesNoCorner) {
  for (const double white : {120.0, 220.0}) {
    const BoardSpec board = aprilGrid();
    TagPictureOptions options = tagsOf(43);
    options.tilt_rad = 15 * kDegree;
    options.noise_gray = 1.1;
    options.black = white - 100;
    options.white = white;
    options.highlight_gray = 55;
    const Picture picture = renderTags(board, options);
    const auto detection = Detector(board).detect(picture.gray);
    ASSERT_TRUE(detection) << white;
    EXPECT_EQ(detection->corners.size(), 48u) << white;
    double largest = 0, z_squares = 0;
    for (const Corner& corner : detection->corners) {
      const Eigen::Vector2d error = corner.pixel - picture.corners[corner.id];
      largest = std::max(largest, error.norm());
      z_squares += corner.covariance_px2.llt().matrixL().solve(error).squaredNorm();
    }
    EXPECT_LT(largest, 0.3) << white;
    EXPECT_LT(std::sqrt(z_squares / (2 * detection->corners.size())), 2.5) << white;
  }
}

}  // namespace
}  // namespace servocal
