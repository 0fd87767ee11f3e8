// SPDX-License-Identifier: GPL-3.0-or-later
#include "ink_map.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "servocal/board/artwork.h"

namespace servocal::sim {
namespace {

constexpr double kTexelM = 0.0002;   // A third of a pixel where cameras come nearest.
constexpr int kMostTexels = 2000;    // Along a side: the table's integers must not overflow.
constexpr int kRaysAcross = 16;      // Per texel at the rim of a disc.

double overlap(double low, double high, int texel) {
  return std::max(0.0, std::min(high, texel + 1.0) - std::max(low, static_cast<double>(texel)));
}

// Share of a texel inside the disc around (x, y).
double discShare(double x, double y, double radius, int column, int row) {
  const double from_centre = std::hypot(column + 0.5 - x, row + 0.5 - y);
  if (from_centre < radius - 0.8) return 1.0;
  if (from_centre > radius + 0.8) return 0.0;
  int inside = 0;
  for (int i = 0; i < kRaysAcross * kRaysAcross; ++i) {
    const double dx = column + (i % kRaysAcross + 0.5) / kRaysAcross - x;
    const double dy = row + (i / kRaysAcross + 0.5) / kRaysAcross - y;
    if (dx * dx + dy * dy <= radius * radius) ++inside;
  }
  return static_cast<double>(inside) / (kRaysAcross * kRaysAcross);
}

}  // namespace

InkMap::InkMap(const BoardSpec& board) {
  const Eigen::Vector2d half = board.outline()[2].head<2>();
  texel_m_ = std::max(kTexelM, 2.0 * half.maxCoeff() / kMostTexels);
  const Eigen::Vector2d size = 2.0 * half / texel_m_;
  cv::Mat ink(static_cast<int>(std::lround(size.y())), static_cast<int>(std::lround(size.x())), CV_32FC1,
              cv::Scalar(0));
  for (const board::Shape& shape : board::artwork(board)) {
    const Eigen::Vector2d low = (shape.centre - shape.half_size + half) / texel_m_;
    const Eigen::Vector2d high = (shape.centre + shape.half_size + half) / texel_m_;
    const int bottom = std::min(ink.rows, static_cast<int>(std::ceil(high.y())));
    const int right = std::min(ink.cols, static_cast<int>(std::ceil(high.x())));
    for (int row = std::max(0, static_cast<int>(low.y())); row < bottom; ++row) {
      for (int column = std::max(0, static_cast<int>(low.x())); column < right; ++column) {
        const Eigen::Vector2d centre = 0.5 * (low + high);
        const double share =
            shape.kind == board::Shape::Kind::kDisc
                ? discShare(centre.x(), centre.y(), 0.5 * (high.x() - low.x()), column, row)
                : overlap(low.x(), high.x(), column) * overlap(low.y(), high.y(), row);
        // Shapes of one color touch but do not overlap: shares of a texel add up.
        float& texel = ink.at<float>(row, column);
        texel = static_cast<float>(std::clamp(texel + (shape.black ? share : -share), 0.0, 1.0));
      }
    }
  }
  cv::Mat bytes;
  ink.convertTo(bytes, CV_8UC1, 255.0);
  cv::integral(bytes, integral_, CV_32S);

  cv::Mat darkest, lightest;
  const cv::Mat window = cv::getStructuringElement(cv::MORPH_RECT, {2 * kReach + 1, 2 * kReach + 1});
  cv::dilate(bytes, darkest, window);
  cv::erode(bytes, lightest, window);
  tone_ = cv::Mat(bytes.size(), CV_8UC1, cv::Scalar(kMixed));
  tone_.setTo(kWhite, darkest == 0);
  tone_.setTo(kBlack, lightest == 255);
}

}  // namespace servocal::sim
