// SPDX-License-Identifier: GPL-3.0-or-later
// The picture of color, infrared and depth over each other, of a scene whose truth is known.
#include <gtest/gtest.h>

#include <cmath>

#include "overlay_picture.h"

namespace servocal::report {
namespace {

constexpr double kWallM = 0.9, kBoxM = 0.6, kHalfBoxM = 0.12;

/// A tiled wall, and a tiled square in front of it, in the color camera's frame.
struct Hit {
  double z_m = 0.0;
  int shade = 0;
};

Hit meet(const Eigen::Vector3d& from, const Eigen::Vector3d& direction) {
  for (const double z_m : {kBoxM, kWallM}) {
    const Eigen::Vector3d at = from + (z_m - from.z()) / direction.z() * direction;
    if (z_m == kBoxM && at.head<2>().cwiseAbs().maxCoeff() > kHalfBoxM) continue;
    const int tile =
        static_cast<int>(std::floor(at.x() / 0.04)) + static_cast<int>(std::floor(at.y() / 0.04));
    return {z_m, tile % 2 == 0 ? 220 : 40};
  }
  return {};
}

class OverlayPicture : public ::testing::Test {
 protected:
  OverlayPicture() {
    truth_.color = CameraModel::fromFieldOfView(1280, 720, 1.2);
    truth_.color.parameters.tail<5>() << 0.06, -0.1, 0.001, -0.001, 0.02;
    truth_.depth.camera = CameraModel::fromFieldOfView(512, 424, 1.2);
    truth_.depth.camera.parameters.tail<5>() << 0.09, -0.26, 0.0002, -0.0001, 0.09;
    truth_.depth.offset = -0.02;
    truth_.depth.slope = 1.01;
    truth_.cMi = Pose<Color, Infrared>::fromRotationVector({0.01, -0.02, 0.005}, {0.052, 0.001, -0.002});
    data_sheet_.color = CameraModel::fromFieldOfView(1280, 720, 1.2);
    data_sheet_.depth.camera = CameraModel::fromFieldOfView(512, 424, 1.2);
    data_sheet_.cMi = Pose<Color, Infrared>::identity();
    draw();
  }

  void draw() {
    const CameraModel &color = truth_.color, &infrared = truth_.depth.camera;
    images_.color.create(color.height_px, color.width_px, CV_8UC1);
    for (int v = 0; v < color.height_px; ++v) {
      for (int u = 0; u < color.width_px; ++u) {
        const auto ray = color.unproject({u, v});
        images_.color.at<std::uint8_t>(v, u) =
            ray ? static_cast<std::uint8_t>(meet(Eigen::Vector3d::Zero(), ray->homogeneous()).shade) : 0;
      }
    }
    images_.infrared.create(infrared.height_px, infrared.width_px, CV_8UC1);
    images_.depth.create(infrared.height_px, infrared.width_px, CV_16UC1);
    for (int v = 0; v < infrared.height_px; ++v) {
      for (int u = 0; u < infrared.width_px; ++u) {
        const auto ray = infrared.unproject({u, v});
        images_.depth.at<std::uint16_t>(v, u) = 0;
        if (!ray) continue;
        const Eigen::Vector3d direction = truth_.cMi.rotation() * ray->homogeneous(),
                              from = truth_.cMi.translation();
        const Hit hit = meet(from, direction);
        // Infrared is brighter and flatter than color.
        images_.infrared.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(90 + hit.shade / 2);
        const double z_m = (hit.z_m - from.z()) / direction.z(), stretch = ray->homogeneous().norm();
        const double raw_m = (z_m * stretch - truth_.depth.offset) / (truth_.depth.slope * stretch);
        images_.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(std::lround(1e3 * raw_m));
      }
    }
  }

  /// Mean difference between what color and what infrared see of the same place.
  static double fringes(const cv::Mat& picture) {
    double sum = 0.0;
    int count = 0;
    for (int v = 40; v < picture.rows - 40; ++v) {
      for (int u = 120; u < picture.cols - 120; ++u) {
        const auto& pixel = picture.at<cv::Vec3b>(v, u);
        if (pixel[0] != pixel[1]) continue;  // yellow
        sum += std::abs(pixel[2] - pixel[1]);
        ++count;
      }
    }
    return sum / count;
  }

  Registration truth_, data_sheet_;
  OverlayImages images_;
};

TEST_F(OverlayPicture, IsGrayWhereTheRegistrationIsRight) {
  ASSERT_TRUE(fits(images_, truth_));
  const cv::Mat right = drawOverlay(images_, truth_);
  EXPECT_EQ(right.cols, 640);
  EXPECT_EQ(right.rows, 360);
  EXPECT_LT(fringes(right),
            14.0);  // of the 180 between dark and bright; edges are as sharp as the coarser camera's
  EXPECT_GT(fringes(drawOverlay(images_, data_sheet_)), 45.0);
  // Negative control: 2 mm aside, a pixel and a half of the picture, shows.
  Registration off = truth_;
  off.cMi =
      Pose<Color, Infrared>(truth_.cMi.rotation(), truth_.cMi.translation() + Eigen::Vector3d(0.002, 0, 0));
  EXPECT_GT(fringes(drawOverlay(images_, off)), fringes(right) + 4.0);
}

// Yellow is where the square in front ends, as the color camera sees it, and nowhere else.
TEST_F(OverlayPicture, JumpsOfTheDepthFollowTheOutline) {
  const cv::Mat picture = drawOverlay(images_, truth_);
  int on_outline = 0, elsewhere = 0;
  for (int v = 0; v < picture.rows; ++v) {
    for (int u = 0; u < picture.cols; ++u) {
      if (picture.at<cv::Vec3b>(v, u) != cv::Vec3b(0, 220, 255)) continue;
      // The picture is half as large as the image.
      const auto ray = truth_.color.unproject({2.0 * u + 0.5, 2.0 * v + 0.5});
      ASSERT_TRUE(ray);
      const double beyond_m = ray->cwiseAbs().maxCoeff() * kBoxM - kHalfBoxM;
      (std::abs(beyond_m) < 0.012 ? on_outline : elsewhere)++;
    }
  }
  EXPECT_GT(on_outline, 200);
  EXPECT_LT(elsewhere, on_outline / 20);
}

TEST_F(OverlayPicture, ImagesOfOtherSizesAreRefused) {
  OverlayImages images = images_;
  images.depth = images.depth(cv::Rect(0, 0, 100, 100));
  EXPECT_FALSE(fits(images, truth_));
  images.depth = cv::Mat();
  EXPECT_FALSE(fits(images, truth_));
  EXPECT_TRUE(readGray("/nowhere", "no.png").empty());
}

}  // namespace
}  // namespace servocal::report
