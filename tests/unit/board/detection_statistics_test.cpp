// SPDX-License-Identifier: GPL-3.0-or-later
// A few seconds' worth of the bench; the nightly test counts more of its frames.
#include "detection_statistics.h"

#include <gtest/gtest.h>

namespace servocal {
namespace {

using test::countBoards;
using test::DetectionCount;
using test::falseBoards;

const cv::Size kVga(640, 480), kInfrared(512, 424);
constexpr unsigned kSeed = 11;

TEST(DetectionStatistics, BoardsAreFoundWhereTheyAre) {
  for (const cv::Size& camera : {kVga, kInfrared}) {
    const DetectionCount count = countBoards(kSeed, camera, 0, 48);
    for (const int tilt : {0, 15, 30, 45}) EXPECT_GE(count.recall(tilt), 5.0 / 6) << camera << ' ' << tilt;
    for (const int tilt : {55, 60}) EXPECT_GE(count.recall(tilt), 4.0 / 6) << camera << ' ' << tilt;
    EXPECT_EQ(count.misplaced, 0) << camera;
    EXPECT_EQ(count.wrong_turns, 0) << camera;
    ASSERT_GT(count.marks, 10) << camera;
    EXPECT_LE(count.undecided, 2) << camera;
    EXPECT_GT(count.zStd(), 0.8) << camera;
    EXPECT_LT(count.zStd(), 1.25) << camera;
  }
}

TEST(DetectionStatistics, NoBoardIsFoundWhereNoneIs) {
  for (const cv::Size& camera : {kVga, kInfrared}) {
    EXPECT_TRUE(falseBoards(test::emptyFrame, BoardSpec(), kSeed, camera, 0, 12).empty()) << camera;
    EXPECT_TRUE(falseBoards(test::otherBoardFrame, BoardSpec(), kSeed, camera, 0, 16).empty()) << camera;
    EXPECT_TRUE(falseBoards(test::coveredFrame, BoardSpec(), kSeed, camera, 0, 16).empty()) << camera;
  }
}

// A part of a blurred 9 x 7 board whose light grows towards the rest of it: halfway between two lines of squares it is
// as bright as a rim.
TEST(DetectionStatistics, APartOfALargerBoardInALightThatGrowsIsNoBoard) {
  EXPECT_TRUE(falseBoards(test::otherBoardFrame, BoardSpec(), 2026, kVga, 5, 6).empty());
}

// Negative control: the same frames have boards for whoever looks for one of 8 x 5 squares.
TEST(DetectionStatistics, MeasuresSeeAFalseBoard) {
  const auto frames = falseBoards(test::otherBoardFrame, test::plainBoard(8, 5), kSeed, kVga, 0, 16);
  EXPECT_EQ(frames, std::vector<int>{2});  // Frames 2 and 3 hold that board; 3 need not be whole in view.
}

}  // namespace
}  // namespace servocal
