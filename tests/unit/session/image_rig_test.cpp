// SPDX-License-Identifier: GPL-3.0-or-later
// Manifests of several cameras.
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "errors.h"
#include "servocal/session/image_set.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

class Rig : public ::testing::Test {
 protected:
  void writeImage(const std::string& name, int width, int height) const {
    std::filesystem::create_directories((folder_ / name).parent_path());
    cv::imwrite((folder_ / name).string(), cv::Mat(height, width, CV_8UC1, cv::Scalar(90)));
  }
  void SetUp() override {
    for (const char* name : {"left1.png", "left2.png", "left10.png"}) writeImage(name, 64, 48);
    for (const char* name : {"infrared/1.png", "infrared/2.png", "infrared/10.png"}) writeImage(name, 32, 24);
  }
  std::vector<ImageSet> load(const std::string& cameras) const {
    return loadImageSets(folder_.write(
        "rig.yaml", "board: {squares_x: 7, squares_y: 5, square_size_m: 0.03, hollow_corner: true}\n" + cameras));
  }
  test::TemporaryFolder folder_;
  const std::string both_ =
      "cameras:\n  - {camera: left, images: \"left*.png\"}\n"
      "  - {camera: infrared, folder: infrared, images: \"*.png\", fixed: [k3]}\n";
};

TEST_F(Rig, EachCameraHasItsFolderAndSize) {
  const std::vector<ImageSet> sets = load(both_);
  ASSERT_EQ(sets.size(), 2u);
  EXPECT_EQ(sets[0].camera, "left");
  EXPECT_EQ(sets[0].width_px, 64);
  EXPECT_EQ(sets[1].camera, "infrared");
  EXPECT_EQ(sets[1].width_px, 32);
  EXPECT_EQ(sets[1].fixed, std::vector<std::string>{"k3"});
  EXPECT_EQ(sets[0].images[2].name, "left10.png");
  EXPECT_EQ(sets[1].images[2].name, "10.png");
}

TEST_F(Rig, AManifestOfOneCameraIsOneSet) {
  const std::vector<ImageSet> sets = load("camera: left\nimages: \"left*.png\"\n");
  ASSERT_EQ(sets.size(), 1u);
  EXPECT_EQ(sets[0].images.size(), 3u);
}

TEST_F(Rig, ImagesMustComeInPairs) {
  writeImage("left11.png", 64, 48);
  test::expectPart(test::messageOf(ErrorKind::kBadData, [&] { load(both_); }),
                   "camera 'left' has 4 images, camera 'infrared' 3");
}

TEST_F(Rig, MistakesAreNamedWithTheirLine) {
  const auto refusal = [&](const std::string& text) {
    return test::messageOf(ErrorKind::kInvalidConfig, [&] { load(text); });
  };
  test::expectPart(refusal("cameras:\n  - {camera: a, images: \"left*.png\"}\n  - {camera: a, images: \"*.png\"}\n"),
                   "rig.yaml:4: two cameras are called 'a'");
  test::expectPart(refusal("cameras:\n  - {images: \"left*.png\"}\n"), "missing key 'camera'");
  test::expectPart(refusal(both_ + "images: \"*.png\"\n"), "unknown key 'images'");
}

}  // namespace
}  // namespace servocal::session
