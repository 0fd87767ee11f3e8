// SPDX-License-Identifier: GPL-3.0-or-later
#include "lens.h"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

namespace servocal::sim {
namespace {

Lens drawnLens(std::uint64_t seed) {
  Random random(seed, "test lens");
  return Lens::draw(SimulatedCameraConfig{}, 1920, 1080, random);
}

Eigen::Vector2d projectedByOpenCv(const Lens& lens, const Eigen::Vector3d& point) {
  const cv::Matx33d camera(lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1);
  const std::vector<double> distortion = {lens.k1, lens.k2, lens.p1, lens.p2, lens.k3};
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(std::vector<cv::Point3d>{{point.x(), point.y(), point.z()}}, cv::Vec3d(0, 0, 0),
                    cv::Vec3d(0, 0, 0), camera, distortion, pixels);
  return {pixels[0].x, pixels[0].y};
}

TEST(Lens, ProjectsLikeOpenCv) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Lens lens = drawnLens(seed);
    Random random(seed, "test points");
    for (int i = 0; i < 200; ++i) {
      const double z = random.uniform(0.3, 3.0);
      const Eigen::Vector3d point(random.uniform(-0.9, 0.9) * z, random.uniform(-0.5, 0.5) * z, z);
      EXPECT_LT((lens.project(point) - projectedByOpenCv(lens, point)).norm(), 1e-6);
    }
  }
}

// Every pixel's ray, projected by OpenCV, comes back to the pixel.
TEST(Lens, RaysComeBackToTheirPixels) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Lens lens = drawnLens(seed);
    for (int v = 0; v < 1080; v += 83) {
      for (int u = 0; u < 1920; u += 101) {
        const Eigen::Vector2d ray = lens.unproject({u, v});
        const Eigen::Vector2d pixel = projectedByOpenCv(lens, {ray.x(), ray.y(), 1.0});
        EXPECT_LT((pixel - Eigen::Vector2d(u, v)).norm(), 1e-6) << u << " " << v;
      }
    }
  }
}

// The table holds floats: 6e-8 of about 1 times 1066 px.
TEST(RayTable, HoldsTheRayOfEveryPixel) {
  const Lens lens = drawnLens(2);
  const RayTable rays(lens);
  for (int v : {0, 1, 539, 1078, 1079}) {
    for (int u : {0, 1, 960, 1918, 1919}) {
      const Eigen::Vector2d pixel = projectedByOpenCv(lens, {rays.xRow(v)[u], rays.yRow(v)[u], 1.0});
      EXPECT_LT((pixel - Eigen::Vector2d(u, v)).norm(), 3e-4) << u << " " << v;
    }
  }
}

// The measure above would see a wrong tangential term or half a pixel.
TEST(Lens, MeasureSeesASmallMistake) {
  Lens lens = drawnLens(1);
  const Eigen::Vector3d point(0.4, -0.2, 0.8);
  const Eigen::Vector2d right = projectedByOpenCv(lens, point);
  std::swap(lens.p1, lens.p2);
  EXPECT_GT((lens.project(point) - right).norm(), 0.01);
}

TEST(Lens, EverySeedIsAnotherLensWithRealDistortion) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const Lens lens = drawnLens(seed);
    EXPECT_GE(std::abs(lens.k1), 0.04);
    EXPECT_NEAR(lens.fx, 1066.0, 1066.0 * 0.02 + 1e-9);
    EXPECT_NEAR(lens.cx, 959.5, 12.0);
    EXPECT_NE(lens.fx, drawnLens(seed + 1).fx);
  }
}

TEST(Lens, WeakDistortionIsRaised) {
  SimulatedCameraConfig config;
  config.distortion = {-0.01, 0.0, 0.0, 0.0, 0.0};
  Random random(1, "test");
  EXPECT_EQ(Lens::draw(config, 1920, 1080, random).k1, -0.04);
}

}  // namespace
}  // namespace servocal::sim
