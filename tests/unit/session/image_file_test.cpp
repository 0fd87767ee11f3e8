// SPDX-License-Identifier: GPL-3.0-or-later
#include "image_file.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "errors.h"
#include "image_list.h"
#include "servocal/session/image_set.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

cv::Mat noiseImage(int width, int height) {
  cv::Mat image(height, width, CV_8UC3);
  cv::RNG random(3);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

TEST(ImageFile, SizeOfWholeFiles) {
  const test::TemporaryFolder folder;
  for (const char* name : {"a.jpg", "a.png", "a.bmp", "progressive.jpg"}) {
    std::vector<int> options;
    if (std::string(name) == "progressive.jpg") options = {cv::IMWRITE_JPEG_PROGRESSIVE, 1};
    ASSERT_TRUE(cv::imwrite((folder / name).string(), noiseImage(123, 77), options));
    const ImageSize size = checkImage(folder / name);
    EXPECT_EQ(size.width_px, 123) << name;
    EXPECT_EQ(size.height_px, 77) << name;
    EXPECT_EQ(readImage(folder / name).size(), cv::Size(123, 77)) << name;
    EXPECT_EQ(readImage(folder / name).type(), CV_8UC1) << name;
  }
}

// Wherever the file is cut, the cut is seen; OpenCV itself decodes most of these without a word.
TEST(ImageFile, TruncationIsSeenEverywhere) {
  const test::TemporaryFolder folder;
  for (const char* ending : {".jpg", ".png"}) {
    std::vector<unsigned char> bytes;
    ASSERT_TRUE(cv::imencode(ending, noiseImage(64, 48), bytes));
    for (std::size_t keep = 1; keep < bytes.size(); keep += 1 + keep / 8) {
      const std::string name = "cut" + std::to_string(keep) + ending;
      folder.write(name, std::string(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(keep)));
      const std::string message = test::messageOf(ErrorKind::kBadData, [&] { checkImage(folder / name); });
      test::expectPart(message, name);
      if (keep > 40) test::expectPart(message, "is truncated");
    }
  }
}

TEST(ImageFile, OtherDamageIsNamed) {
  const test::TemporaryFolder folder;
  const auto refusal = [&](const std::string& name) {
    return test::messageOf(ErrorKind::kBadData, [&] { checkImage(folder / name); });
  };
  folder.write("empty.png", "");
  test::expectPart(refusal("empty.png"), "is empty");
  folder.write("text.jpg", "not an image at all");
  test::expectPart(refusal("text.jpg"), "is not an image");
  test::expectPart(refusal("nothing.jpg"), "is not there");
}

TEST(ImageList, NaturalOrder) {
  const test::TemporaryFolder folder;
  for (const char* name : {"10.png", "2.png", "1.png", "a.txt", "b02.png", "b1.png"}) folder.write(name, "x");
  EXPECT_EQ(matchingFiles(folder.path(), "*.png"),
            (std::vector<std::string>{"1.png", "2.png", "10.png", "b1.png", "b02.png"}));
  EXPECT_TRUE(matchingFiles(folder.path(), "*.jpg").empty());
  EXPECT_TRUE(naturallyBefore("frame_000", "frame_100"));
  EXPECT_FALSE(naturallyBefore("a", "a"));
}

}  // namespace
}  // namespace servocal::session
