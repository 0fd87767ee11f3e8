// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "pictures.h"
#include "servocal/board/detector.h"
#include "tags.h"

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

// The library's own test images: loose tags of many sizes, with corners in its convention (pixel centres at
// one half, counter-clockwise from the lower left). With its default limits it finds 12, 23 and 10 itself; ours
// on contrast and corrected bits are stricter, which costs one.
TEST(TagRecordings, TagsAreReadWhereTheLibrarysTruthHasThem) {
  const char* data = std::getenv("SERVOCAL_TEST_DATA");
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const auto folder = std::filesystem::path(data) / "apriltag_test";
  const std::vector<std::pair<std::string, int>> least = {
      {"33369213973_9d9bb4cc96_c", 12}, {"34085369442_304b6bafd9_c", 23}, {"34139872896_defdb2f8d9_c", 9}};
  for (const auto& [name, count] : least) {
    const cv::Mat image = cv::imread(folder / (name + ".jpg"), cv::IMREAD_GRAYSCALE);
    ASSERT_FALSE(image.empty()) << name;
    const std::vector<board::SeenTag> seen = board::makeAprilTagReader(1)->read(image, 1);
    std::ifstream truth(folder / (name + ".txt"));
    int expected = 0, found = 0;
    std::string line;
    while (std::getline(truth, line)) {
      for (char& c : line)
        if (c == ',' || c == '(' || c == ')') c = ' ';
      std::istringstream numbers(line);
      int code = 0;
      board::TagCorners corners;
      numbers >> code;
      for (int k = 3; k >= 0; --k) numbers >> corners[k].x() >> corners[k].y();
      if (!numbers) continue;
      ++expected;
      found += std::any_of(seen.begin(), seen.end(), [&](const board::SeenTag& tag) {
        if (tag.code != code) return false;
        for (int k = 0; k < 4; ++k)
          if ((tag.corners[k] + Eigen::Vector2d(0.5, 0.5) - corners[k]).norm() > 1.0) return false;
        return true;
      });
    }
    EXPECT_GE(expected, count) << name;
    EXPECT_GE(found, count) << name << ", of " << expected;
  }
}

}  // namespace
}  // namespace servocal
