// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "pictures.h"
#include "servocal/board/detector.h"

namespace servocal {
namespace {

struct Recording {
  const char* folder;
  const char* prefix;  // Of the file names.
  int squares_x, squares_y;
  int images, least_found;
};

class Recordings : public testing::TestWithParam<Recording> {};

// Boards other people own, in pictures of their cameras.
TEST_P(Recordings, ShowTheBoard) {
  const char* data = std::getenv("SERVOCAL_TEST_DATA");
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const Recording& recording = GetParam();
  const BoardSpec board = test::plainBoard(recording.squares_x, recording.squares_y);
  int images = 0, found = 0;
  std::string missed;
  for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(data) / recording.folder)) {
    const std::string name = entry.path().filename();
    if (entry.path().extension() != ".jpg" || name.rfind(recording.prefix, 0) != 0) continue;
    ++images;
    board::Detector detector(board);
    const cv::Mat image = cv::imread(entry.path());
    const auto detection = detector.detect(image);
    if (!detection) {
      missed += " " + name;
      continue;
    }
    ++found;
    EXPECT_EQ(static_cast<int>(detection->corners.size()), board.cornerCount());
    EXPECT_EQ(detection->orientation_known, board.symmetry() == 1) << name;
    EXPECT_TRUE(detector.track(image)) << name;
    // A board of another size is not in the same picture.
    EXPECT_FALSE(board::Detector(test::plainBoard(recording.squares_x - 1, recording.squares_y)).detect(image)) << name;
  }
  EXPECT_EQ(images, recording.images);
  EXPECT_GE(found, recording.least_found) << "missed:" << missed;
}

INSTANTIATE_TEST_SUITE_P(
    Real, Recordings,
    testing::Values(Recording{"opencv_stereo", "left", 10, 7, 13, 13}, Recording{"opencv_stereo", "right", 10, 7, 13, 13},
                    Recording{"boofcv/Sony_DSC-HX5V_Chess", "frame", 5, 7, 13, 13},
                    Recording{"boofcv/Bumblebee2_Chess", "", 5, 7, 22, 22},
                    Recording{"yz_toolkit/eye_in_hand_test_data", "", 12, 9, 6, 6},
                    Recording{"mrpt_stereo", "", 10, 7, 8, 8},
                    // In one of the eight the board is cut off by the image's edge.
                    Recording{"caliscope_chess", "", 10, 7, 8, 7}));

}  // namespace
}  // namespace servocal
