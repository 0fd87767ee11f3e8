// SPDX-License-Identifier: GPL-3.0-or-later
#include "jpeg.h"

#include <algorithm>
#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "servocal/core/base64.h"

namespace servocal::live {
namespace {

constexpr int kWidestPx = 960;
constexpr int kQuality = 75;
constexpr int kSerialPx = 1 << 16;  // OpenCV resizes so many pixels at a time without its pool

/// Every `factor`-th pixel each way, averaged over those between. OpenCV's thread pool is one for the whole
/// program, and whoever waits for a part of it works on the others' parts meanwhile: the run's loop would
/// shrink pictures for browsers. In bands of so few rows the pool is not asked.
cv::Mat shrunk(const cv::Mat& image, int factor) {
  cv::Mat small(image.rows / factor, image.cols / factor, image.type());
  const int band = std::max(1, kSerialPx / small.cols);
  for (int row = 0; row < small.rows; row += band) {
    const int end = std::min(row + band, small.rows);
    cv::Mat to = small.rowRange(row, end);
    cv::resize(image.rowRange(row * factor, end * factor).colRange(0, small.cols * factor), to, to.size(), 0,
               0, cv::INTER_AREA);
  }
  return small;
}

}  // namespace

std::string jpegDataUrl(const cv::Mat& image) {
  const int factor = (image.cols + kWidestPx - 1) / kWidestPx;
  cv::Mat small = factor > 1 ? shrunk(image, factor) : image;
  if (small.depth() == CV_16U) cv::normalize(small.clone(), small, 0, 255, cv::NORM_MINMAX, CV_8U);
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", small, bytes, {cv::IMWRITE_JPEG_QUALITY, kQuality});
  return "data:image/jpeg;base64," + base64(bytes);
}

}  // namespace servocal::live
