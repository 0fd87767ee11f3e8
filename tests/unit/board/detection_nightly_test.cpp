// SPDX-License-Identifier: GPL-3.0-or-later
// The claims of docs/results.md over hundreds of frames.
#include <gtest/gtest.h>

#include "detection_statistics.h"

namespace servocal {
namespace {

constexpr unsigned kSeed = 12;
constexpr int kFrames = 400;

class DetectionNightly : public testing::TestWithParam<std::pair<int, int>> {
 protected:
  cv::Size camera() const { return {GetParam().first, GetParam().second}; }
};

TEST_P(DetectionNightly, BoardsAreFoundWhereTheyAre) {
  const test::DetectionCount count = test::countBoards(kSeed, camera(), 0, kFrames);
  for (const auto& [tilt, least] : {std::pair(0, 0.97), {15, 0.97}, {30, 0.97}, {45, 0.95}, {55, 0.93}, {60, 0.9},
                                    {65, 0.8}, {70, 0.5}})
    EXPECT_GE(count.recall(tilt), least) << tilt << " degrees";
  EXPECT_LE(count.misplaced, 1);
  EXPECT_EQ(count.wrong_turns, 0);
  EXPECT_LE(count.undecided, 0.03 * count.marks);
  EXPECT_GT(count.zStd(), 0.8);
  EXPECT_LT(count.zStd(), 1.25);
}

TEST_P(DetectionNightly, HardlyABoardIsFoundWhereNoneIs) {
  const auto frames = [&](auto frame_of) { return test::falseBoards(frame_of, BoardSpec(), kSeed, camera(), 0, kFrames / 4); };
  EXPECT_LE(frames(test::emptyFrame).size(), 0u);
  EXPECT_LE(frames(test::otherBoardFrame).size(), 1u);
  EXPECT_LE(frames(test::coveredFrame).size(), 2u);
}

INSTANTIATE_TEST_SUITE_P(Cameras, DetectionNightly, testing::Values(std::pair(640, 480), std::pair(512, 424)));

}  // namespace
}  // namespace servocal
