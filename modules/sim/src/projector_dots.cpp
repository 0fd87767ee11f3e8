// SPDX-License-Identifier: GPL-3.0-or-later
#include "projector_dots.h"

#include <opencv2/imgproc.hpp>

#include "random.h"

namespace servocal::sim {
namespace {

constexpr int kPeriodPx = 1024;    // The pattern repeats; a power of two.
constexpr double kDotShare = 0.1;  // Of the pixels that begin a dot.
constexpr float kBetween = 0.35F;  // Light between dots.

}  // namespace

cv::Mat withProjectorDots(const cv::Mat& image, const cv::Mat& depth, double focal_baseline,
                          std::uint64_t seed) {
  Random random(seed, "projector dots");
  cv::Mat pattern(image.rows, kPeriodPx, CV_32FC1);
  for (int v = 0; v < pattern.rows; ++v) {
    for (int u = 0; u < pattern.cols; ++u) pattern.at<float>(v, u) = random.unit() < kDotShare ? 5.0F : 0.0F;
  }
  cv::GaussianBlur(pattern, pattern, {5, 5}, 0.7);
  cv::Mat lit(image.size(), CV_8UC1);
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      float light = kBetween;
      if (const int z = depth.at<std::uint16_t>(v, u); z > 0) {
        const int column = (u + static_cast<int>(focal_baseline / z)) & (kPeriodPx - 1);
        light += pattern.at<float>(v, column);
      }
      lit.at<std::uint8_t>(v, u) = cv::saturate_cast<std::uint8_t>(light * image.at<std::uint8_t>(v, u));
    }
  }
  return lit;
}

}  // namespace servocal::sim
