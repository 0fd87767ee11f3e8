// SPDX-License-Identifier: GPL-3.0-or-later
#include "pixels.h"

#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

namespace servocal::openni2 {
namespace {

int typeOf(openni::PixelFormat format) {
  switch (format) {
    case openni::PIXEL_FORMAT_RGB888: return CV_8UC3;
    case openni::PIXEL_FORMAT_GRAY8: return CV_8UC1;
    case openni::PIXEL_FORMAT_YUV422:
    case openni::PIXEL_FORMAT_YUYV: return CV_8UC2;
    case openni::PIXEL_FORMAT_GRAY16:
    case openni::PIXEL_FORMAT_DEPTH_1_MM:
    case openni::PIXEL_FORMAT_DEPTH_100_UM: return CV_16UC1;
    default: throw std::invalid_argument(std::string("imageOf: cannot read ") + nameOf(format));
  }
}

}  // namespace

const std::vector<openni::PixelFormat>& formatsOf(Stream stream) {
  static const std::vector<openni::PixelFormat> color{openni::PIXEL_FORMAT_RGB888, openni::PIXEL_FORMAT_YUYV,
                                                      openni::PIXEL_FORMAT_YUV422,
                                                      openni::PIXEL_FORMAT_GRAY8};
  static const std::vector<openni::PixelFormat> infrared{openni::PIXEL_FORMAT_GRAY16,
                                                         openni::PIXEL_FORMAT_GRAY8};
  static const std::vector<openni::PixelFormat> depth{openni::PIXEL_FORMAT_DEPTH_1_MM,
                                                      openni::PIXEL_FORMAT_DEPTH_100_UM};
  switch (stream) {
    case Stream::kColor: return color;
    case Stream::kInfrared: return infrared;
    case Stream::kDepth: return depth;
  }
  throw std::invalid_argument("formatsOf: no such stream");
}

const char* nameOf(openni::PixelFormat format) {
  switch (format) {
    case openni::PIXEL_FORMAT_DEPTH_1_MM: return "depth in mm";
    case openni::PIXEL_FORMAT_DEPTH_100_UM: return "depth in 0.1 mm";
    case openni::PIXEL_FORMAT_RGB888: return "RGB";
    case openni::PIXEL_FORMAT_YUV422: return "UYVY";
    case openni::PIXEL_FORMAT_YUYV: return "YUYV";
    case openni::PIXEL_FORMAT_GRAY8: return "gray, 8 bits";
    case openni::PIXEL_FORMAT_GRAY16: return "gray, 16 bits";
    case openni::PIXEL_FORMAT_JPEG: return "JPEG";
    case openni::PIXEL_FORMAT_SHIFT_9_2: return "disparity (9.2)";
    case openni::PIXEL_FORMAT_SHIFT_9_3: return "disparity (9.3)";
  }
  return "an unknown format";
}

cv::Mat imageOf(openni::PixelFormat format, int width, int height, int stride, const void* data) {
  // cv::Mat has no view of constant pixels; it is only read.
  const cv::Mat pixels(height, width, typeOf(format), const_cast<void*>(data),
                       static_cast<std::size_t>(stride));
  cv::Mat image;
  switch (format) {
    case openni::PIXEL_FORMAT_RGB888: cv::cvtColor(pixels, image, cv::COLOR_RGB2BGR); break;
    case openni::PIXEL_FORMAT_YUYV: cv::cvtColor(pixels, image, cv::COLOR_YUV2BGR_YUYV); break;
    case openni::PIXEL_FORMAT_YUV422: cv::cvtColor(pixels, image, cv::COLOR_YUV2BGR_UYVY); break;
    case openni::PIXEL_FORMAT_DEPTH_100_UM: pixels.convertTo(image, CV_16U, 0.1); break;
    default: image = pixels.clone(); break;
  }
  return image;
}

}  // namespace servocal::openni2
