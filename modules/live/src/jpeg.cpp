// SPDX-License-Identifier: GPL-3.0-or-later
#include "jpeg.h"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "servocal/core/base64.h"

namespace servocal::live {
namespace {

constexpr int kWidestPx = 960;
constexpr int kQuality = 75;

}  // namespace

std::string jpegDataUrl(const cv::Mat& image) {
  cv::Mat small = image;
  if (image.cols > kWidestPx) {
    const double scale = static_cast<double>(kWidestPx) / image.cols;
    cv::resize(image, small, {}, scale, scale, cv::INTER_AREA);
  }
  if (small.depth() == CV_16U) cv::normalize(small.clone(), small, 0, 255, cv::NORM_MINMAX, CV_8U);
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", small, bytes, {cv::IMWRITE_JPEG_QUALITY, kQuality});
  return "data:image/jpeg;base64," + base64(bytes);
}

}  // namespace servocal::live
