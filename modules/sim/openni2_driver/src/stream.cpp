// SPDX-License-Identifier: GPL-3.0-or-later
#include "stream.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/imgproc.hpp>

namespace servocal::sim_openni2_driver {
namespace {

constexpr double kInfraredCountsPerGray = 4.0;  // Ten bits of infrared, as a Kinect v1.
constexpr double kTenthsPerMm = 10.0;

int sensorType(Stream stream) {
  return stream == Stream::kColor   ? ONI_SENSOR_COLOR
         : stream == Stream::kDepth ? ONI_SENSOR_DEPTH
                                    : ONI_SENSOR_IR;
}

/// The pixels as the mode has them.
cv::Mat encode(const cv::Mat& image, const OniVideoMode& mode) {
  cv::Mat encoded;
  switch (mode.pixelFormat) {
    case ONI_PIXEL_FORMAT_RGB888:
      cv::cvtColor(image, encoded, image.channels() == 1 ? cv::COLOR_GRAY2RGB : cv::COLOR_BGR2RGB);
      break;
    case ONI_PIXEL_FORMAT_GRAY16:
      image.convertTo(encoded, CV_16U, image.depth() == CV_8U ? kInfraredCountsPerGray : 1.0);
      break;
    case ONI_PIXEL_FORMAT_DEPTH_100_UM: image.convertTo(encoded, CV_16U, kTenthsPerMm); break;
    default: encoded = image.clone(); break;
  }
  return encoded;
}

template <typename T>
OniStatus give(const T& value, void* data, int* size) {
  if (*size < static_cast<int>(sizeof(T))) return ONI_STATUS_BAD_PARAMETER;
  std::memcpy(data, &value, sizeof(T));
  *size = sizeof(T);
  return ONI_STATUS_OK;
}

template <typename T>
OniStatus take(T& value, const void* data, int size) {
  if (size != static_cast<int>(sizeof(T))) return ONI_STATUS_BAD_PARAMETER;
  std::memcpy(&value, data, sizeof(T));
  return ONI_STATUS_OK;
}

int bytesPerPixel(const OniVideoMode& mode) { return mode.pixelFormat == ONI_PIXEL_FORMAT_RGB888 ? 3 : 2; }

}  // namespace

ServedStream::ServedStream(Stream stream, std::vector<OniVideoMode> modes)
    : stream_(stream), modes_(std::move(modes)), mode_(modes_.front()) {}

OniStatus ServedStream::start() {
  for (const ServedStream* rival : rivals_) {
    if (rival->isRunning()) return ONI_STATUS_ERROR;
  }
  running_ = true;
  return ONI_STATUS_OK;
}

OniStatus ServedStream::setProperty(int id, const void* data, int size) {
  switch (id) {
    case ONI_STREAM_PROPERTY_MIRRORING: return take(mirrored_, data, size);
    case ONI_STREAM_PROPERTY_AUTO_EXPOSURE:
      return isColor() ? take(auto_exposure_, data, size) : ONI_STATUS_NOT_SUPPORTED;
    case ONI_STREAM_PROPERTY_AUTO_WHITE_BALANCE:
      return isColor() ? take(auto_white_balance_, data, size) : ONI_STATUS_NOT_SUPPORTED;
    case ONI_STREAM_PROPERTY_VIDEO_MODE: {
      OniVideoMode wanted;
      const OniStatus status = take(wanted, data, size);
      if (status != ONI_STATUS_OK) return status;
      const bool offered = std::any_of(modes_.begin(), modes_.end(), [&](const OniVideoMode& mode) {
        return std::memcmp(&mode, &wanted, sizeof(mode)) == 0;
      });
      if (!offered) return ONI_STATUS_NOT_SUPPORTED;
      mode_ = wanted;
      return ONI_STATUS_OK;
    }
    default: return ONI_STATUS_NOT_IMPLEMENTED;
  }
}

OniStatus ServedStream::getProperty(int id, void* data, int* size) {
  switch (id) {
    case ONI_STREAM_PROPERTY_VIDEO_MODE: return give(mode_, data, size);
    case ONI_STREAM_PROPERTY_MIRRORING: return give(mirrored_, data, size);
    case ONI_STREAM_PROPERTY_AUTO_EXPOSURE: return give(auto_exposure_, data, size);
    case ONI_STREAM_PROPERTY_AUTO_WHITE_BALANCE: return give(auto_white_balance_, data, size);
    // A recording holds no frame without the next two.
    case ONI_STREAM_PROPERTY_STRIDE: return give(mode_.resolutionX * bytesPerPixel(mode_), data, size);
    case ONI_STREAM_PROPERTY_CROPPING: return give(OniCropping{}, data, size);
    case ONI_STREAM_PROPERTY_HORIZONTAL_FOV: return give(1.0F, data, size);
    case ONI_STREAM_PROPERTY_VERTICAL_FOV: return give(0.8F, data, size);
    case ONI_STREAM_PROPERTY_MAX_VALUE: return give(stream_ == Stream::kInfrared ? 1023 : 65535, data, size);
    case ONI_STREAM_PROPERTY_MIN_VALUE: return give(0, data, size);
    default: return ONI_STATUS_NOT_IMPLEMENTED;
  }
}

OniBool ServedStream::isPropertySupported(int id) {
  switch (id) {
    case ONI_STREAM_PROPERTY_VIDEO_MODE:
    case ONI_STREAM_PROPERTY_MIRRORING:
    case ONI_STREAM_PROPERTY_STRIDE:
    case ONI_STREAM_PROPERTY_CROPPING:
    case ONI_STREAM_PROPERTY_HORIZONTAL_FOV:
    case ONI_STREAM_PROPERTY_VERTICAL_FOV:
    case ONI_STREAM_PROPERTY_MAX_VALUE:
    case ONI_STREAM_PROPERTY_MIN_VALUE: return TRUE;
    case ONI_STREAM_PROPERTY_AUTO_EXPOSURE:
    case ONI_STREAM_PROPERTY_AUTO_WHITE_BALANCE: return isColor() ? TRUE : FALSE;
    default: return FALSE;
  }
}

void ServedStream::push(const sensor::Frame& frame) {
  OniFrame* const out = getServices().acquireFrame();
  if (out == nullptr) return;
  cv::Mat pixels = encode(frame.image, mode_);
  const cv::Size size(mode_.resolutionX, mode_.resolutionY);
  if (pixels.size() != size) cv::resize(pixels, pixels, size, 0, 0, cv::INTER_NEAREST);
  if (mirrored_ != FALSE) cv::flip(pixels, pixels, 1);
  out->sensorType = static_cast<OniSensorType>(sensorType(stream_));
  out->timestamp = static_cast<std::uint64_t>(std::llround(frame.device_stamp_s * 1e6));
  out->frameIndex = static_cast<int>(frame.sequence);
  out->videoMode = mode_;
  out->width = mode_.resolutionX;
  out->height = mode_.resolutionY;
  out->stride = mode_.resolutionX * bytesPerPixel(mode_);
  out->croppingEnabled = FALSE;
  out->cropOriginX = out->cropOriginY = 0;
  out->dataSize = out->stride * out->height;
  std::memcpy(out->data, pixels.data, static_cast<std::size_t>(out->dataSize));  // Fresh images have no gaps.
  raiseNewFrame(out);
  getServices().releaseFrame(out);
}

}  // namespace servocal::sim_openni2_driver
