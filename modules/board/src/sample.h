// SPDX-License-Identifier: GPL-3.0-or-later
// Brightness between pixels; images are CV_8UC1, a pixel's centre has whole coordinates.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace servocal::board {

/// True if all four pixels around a place are in the image; false for places that are not numbers.
inline bool insideImage(const cv::Mat& gray, const Eigen::Vector2d& p) {
  return p.x() >= 0 && p.y() >= 0 && p.x() < gray.cols - 1 && p.y() < gray.rows - 1;
}

/// Bilinear interpolation at a place insideImage().
inline double bilinear(const cv::Mat& gray, const Eigen::Vector2d& p) {
  const int x = static_cast<int>(p.x()), y = static_cast<int>(p.y());
  const double fx = p.x() - x, fy = p.y() - y;
  const uchar* a = gray.ptr<uchar>(y) + x;
  const uchar* b = gray.ptr<uchar>(y + 1) + x;
  return (1 - fy) * ((1 - fx) * a[0] + fx * a[1]) + fy * ((1 - fx) * b[0] + fx * b[1]);
}

/// The same, or nothing if outside the image.
inline std::optional<double> brightnessAt(const cv::Mat& gray, const Eigen::Vector2d& p) {
  if (!insideImage(gray, p)) return std::nullopt;
  return bilinear(gray, p);
}

}  // namespace servocal::board
