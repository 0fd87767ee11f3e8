// SPDX-License-Identifier: GPL-3.0-or-later
#include "jpeg.h"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace servocal::live {
namespace {

constexpr int kWidestPx = 960;
constexpr int kQuality = 75;

std::string base64(const std::vector<std::uint8_t>& bytes) {
  static constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t at = 0; at < bytes.size(); at += 3) {
    const std::size_t left = bytes.size() - at;
    const std::uint32_t three =
        bytes[at] << 16 | (left > 1 ? bytes[at + 1] << 8 : 0) | (left > 2 ? bytes[at + 2] : 0);
    text += kDigits[three >> 18];
    text += kDigits[three >> 12 & 63];
    text += left > 1 ? kDigits[three >> 6 & 63] : '=';
    text += left > 2 ? kDigits[three & 63] : '=';
  }
  return text;
}

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
