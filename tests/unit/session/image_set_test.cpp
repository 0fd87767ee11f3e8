// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/session/image_set.h"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "errors.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

using test::expectPart;
using test::messageOf;

const char* const kBoard = "board: {squares_x: 7, squares_y: 5, square_size_m: 0.03, hollow_corner: false}\n";

class Images : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"1.png", "2.png", "10.png"}) writeImage(name, 64, 48);
  }
  void writeImage(const std::string& name, int width, int height) const {
    std::filesystem::create_directories((folder_ / "set" / name).parent_path());
    cv::imwrite((folder_ / "set" / name).string(), cv::Mat(height, width, CV_8UC1, cv::Scalar(90)));
  }
  ImageSet load(const std::string& text) const { return loadImageSet(folder_.write("set.yaml", text)); }
  std::string refusal(ErrorKind kind, const std::string& text) const {
    return messageOf(kind, [&] { load(text); });
  }
  test::TemporaryFolder folder_;
  const std::string images_ = std::string(kBoard) + "folder: set\nimages: \"*.png\"\n";
  const std::string poses_ =
      images_ +
      "mount: eye_in_hand\nposes: {pose: bMe, format: matrix, length_unit: m, files: \"{stem}.txt\"}\n";
};

TEST_F(Images, WithoutPoses) {
  const ImageSet set = load(images_ + "camera: left\nlens: rational_polynomial\nfixed: [k6]\n");
  ASSERT_EQ(set.images.size(), 3u);
  EXPECT_EQ(set.images[2].name, "10.png");
  EXPECT_FALSE(set.images[0].bMe.has_value());
  EXPECT_EQ(set.camera, "left");
  EXPECT_EQ(set.lens, LensModel::kRational);
  EXPECT_EQ(set.fixed, std::vector<std::string>{"k6"});
  EXPECT_EQ(set.width_px, 64);
  EXPECT_EQ(set.board.as<Checkerboard>()->squares_x, 7);
}

TEST_F(Images, WithPosesAndARootOfItsOwn) {
  for (const char* name : {"1", "2", "10"}) {
    folder_.write(std::string("set/") + name + ".txt",
                  std::string("1 0 0 0.") + name + " 0 1 0 0 0 0 1 0 0 0 0 1");
  }
  const ImageSet set = load(poses_);
  EXPECT_EQ(set.mount, Mount::kFlange);
  EXPECT_EQ(set.images[1].bMe->translation().x(), 0.2);
  const test::TemporaryFolder elsewhere;
  const ImageSet same = loadImageSet(elsewhere.write("m.yaml", poses_), folder_.path());
  EXPECT_EQ(same.images[2].bMe->translation().x(), 0.10);
}

TEST_F(Images, AnImageWithoutItsPoseIsNamed) {
  folder_.write("set/1.txt", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1");
  expectPart(refusal(ErrorKind::kBadData, poses_), "image '2.png' has no robot pose: '");
}

TEST_F(Images, NothingToDo) {
  expectPart(refusal(ErrorKind::kNothingToDo, std::string(kBoard) + "folder: set\nimages: \"*.tif\"\n"),
             "matches '*.tif'");
  expectPart(refusal(ErrorKind::kNothingToDo, std::string(kBoard) + "folder: nowhere\nimages: \"*.png\"\n"),
             "nowhere' is not there");
  expectPart(refusal(ErrorKind::kNothingToDo, std::string(kBoard) + "folder: set\nimage_list: []\n"),
             "lists no image");
}

TEST_F(Images, MalformedManifests) {
  const auto refused = [&](const std::string& text) { return refusal(ErrorKind::kInvalidConfig, text); };
  expectPart(refused(images_ + "lense: plumb_bob\n"),
             "set.yaml:4: unknown key 'lense'; did you mean 'lens'?");
  expectPart(refused("folder: set\nimages: \"*\"\n"), "say either 'board'");
  expectPart(refused(std::string(kBoard) + "folder: set\n"), "say either 'images'");
  expectPart(refused(images_ + "fixed: [fx]\n"), "'fixed' names 'fx', allowed: k1, k2, p1, p2, k3");
  expectPart(
      refused(images_ + "poses: {pose: bMe, format: matrix, length_unit: m, files: \"{stem}\", colums: [x]}\n"
                        "mount: eye_in_hand\n"),
      "unknown key 'colums'");
  expectPart(refused(images_ + "poses: {pose: bMe, format: matrix, length_unit: m, files: \"{stem}\"}\n"),
             "missing key 'mount'");
  expectPart(refused(std::string(kBoard) + "folder: set\nimage_list: [1.png, 1.png]\n"),
             "'1.png' is listed twice");
  expectPart(refused("board_file: b.yaml\nfolder: set\nimages: \"*\"\n"), "b.yaml': there is no such file");
}

TEST_F(Images, AnImageOfAnotherSizeIsNamed) {
  writeImage("3.png", 640, 480);
  const std::string message = refusal(ErrorKind::kBadData, images_);
  expectPart(message, "set/3.png' has 640x480 px, most others have 64x48");
  // Also if it comes first.
  writeImage("0.png", 640, 480);
  expectPart(refusal(ErrorKind::kBadData, images_), "set/0.png' has 640x480 px");
}

TEST_F(Images, ATruncatedImageIsNamed) {
  writeImage("3.png", 64, 48);
  std::filesystem::resize_file(folder_ / "set/3.png", std::filesystem::file_size(folder_ / "set/3.png") / 2);
  expectPart(refusal(ErrorKind::kBadData, images_), "set/3.png' is truncated");
  expectPart(refusal(ErrorKind::kBadData, std::string(kBoard) + "folder: set\nimage_list: [1.png, 7.png]\n"),
             "7.png' is not there");
}

TEST_F(Images, GivenIntrinsics) {
  folder_.write("ros.yaml",
                "image_width: 64\nimage_height: 48\ncamera_name: c\n"
                "camera_matrix: {rows: 3, cols: 3, data: [525.1, 0, 31.5, 0, 526.2, 23.5, 0, 0, 1]}\n"
                "distortion_model: plumb_bob\n"
                "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0.001, -0.002, 0.03]}\n");
  const ImageSet ros = load(images_ + "intrinsics_file: ros.yaml\n");
  ASSERT_TRUE(ros.given_intrinsics.has_value());
  EXPECT_EQ(ros.given_intrinsics->lens, LensModel::kPlumbBob);
  EXPECT_EQ(ros.given_intrinsics->fy(), 526.2);
  EXPECT_EQ(ros.given_intrinsics->cx(), 31.5);
  EXPECT_EQ(ros.given_intrinsics->parameters[8], 0.03);
  {
    cv::FileStorage storage((folder_ / "cv.yml").string(), cv::FileStorage::WRITE);
    storage << "camera_matrix" << (cv::Mat_<double>(3, 3) << 500, 0, 32, 0, 501, 24, 0, 0, 1);
    storage << "distortion_coefficients" << (cv::Mat_<double>(8, 1) << 1, 2, 3, 4, 5, 6, 7, 8);
  }
  const ImageSet opencv = load(images_ + "intrinsics_file: cv.yml\n");
  EXPECT_EQ(opencv.given_intrinsics->lens, LensModel::kRational);
  EXPECT_EQ(opencv.given_intrinsics->parameters[11], 8.0);
  folder_.write("big.yaml", "image_width: 640\nimage_height: 480\nK: [1, 0, 1, 0, 1, 1, 0, 0, 1]\nD: []\n");
  expectPart(refusal(ErrorKind::kBadData, images_ + "intrinsics_file: big.yaml\n"),
             "it was made for images of 640x480 px, these have 64x48");
  folder_.write("fisheye.yaml",
                "distortion_model: equidistant\nK: [1, 0, 1, 0, 1, 1, 0, 0, 1]\nD: [0, 0, 0, 0]\n");
  expectPart(refusal(ErrorKind::kBadData, images_ + "intrinsics_file: fisheye.yaml\n"),
             "'equidistant' is none of");
}

}  // namespace
}  // namespace servocal::session
