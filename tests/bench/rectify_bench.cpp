// SPDX-License-Identifier: GPL-3.0-or-later
// CPU time of correcting a depth image and registering it to color, on one thread.
#include <ctime>
#include <iostream>
#include <opencv2/core.hpp>

#include "depth_scene.h"
#include "servocal/sensor/rectify.h"

int main() {
  using namespace servocal;
  cv::setNumThreads(1);
  const Pose<Color, Infrared> cMi(Eigen::Matrix3d::Identity(), {0.052, 0.0, 0.0});
  CameraModel vga = CameraModel::fromFieldOfView(640, 480, 1.1);
  const struct {
    const char* name;
    DepthModel depth;
    CameraModel color;
  } cases[] = {{"time of flight, 512 x 424 -> 1920 x 1080", test::wigglingTimeOfFlight(), test::hdCamera()},
               {"structured light, 640 x 480 -> 640 x 480", test::structuredLight(), vga}};
  for (const auto& one : cases) {
    const sensor::DepthRectifier rectifier(one.depth, one.color, cMi);
    cv::Mat raw(one.depth.camera.height_px, one.depth.camera.width_px, CV_16UC1);
    for (int row = 0; row < raw.rows; ++row) {
      for (int column = 0; column < raw.cols; ++column) {
        raw.at<std::uint16_t>(row, column) = static_cast<std::uint16_t>(700 + column / 4 + row / 3);
      }
    }
    constexpr int kImages = 50;
    const std::clock_t start = std::clock();
    int filled = 0;
    for (int k = 0; k < kImages; ++k) filled += rectifier.registeredMm(raw).at<std::uint16_t>(240, 320) != 0 ? 1 : 0;
    const double each_s = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC / kImages;
    std::cout << one.name << ": " << 1e3 * each_s << " ms, " << 1.0 / each_s << " Hz (" << filled << " of " << kImages
              << " have depth in the middle)\n";
  }
}
