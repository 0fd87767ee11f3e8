// SPDX-License-Identifier: GPL-3.0-or-later
#include "openni_stream.h"

#include <algorithm>
#include <set>

#include "library.h"
#include "pixels.h"
#include "servocal/core/error.h"
#include "servocal/sensor/infrared.h"

namespace servocal::openni2 {
namespace {

openni::SensorType sensorOf(Stream stream) {
  switch (stream) {
    case Stream::kColor: return openni::SENSOR_COLOR;
    case Stream::kInfrared: return openni::SENSOR_IR;
    case Stream::kDepth: return openni::SENSOR_DEPTH;
  }
  return openni::SENSOR_COLOR;
}

std::string sizeText(int width, int height) { return std::to_string(width) + " x " + std::to_string(height); }

[[noreturn]] void refuse(const std::string& sentence) { throw Error(ErrorKind::kHardwareAbsent, sentence); }

/// Of the modes of the right size the one in the best format, then the fastest.
openni::VideoMode chooseMode(const openni::SensorInfo& info, const sensor::StreamMode& wanted,
                             const std::string& name) {
  const auto& formats = formatsOf(wanted.stream);
  const auto& offered = info.getSupportedVideoModes();
  const openni::VideoMode* best = nullptr;
  auto best_rank = formats.end();
  std::set<std::string> sizes, unread;
  for (int i = 0; i < offered.getSize(); ++i) {
    const openni::VideoMode& mode = offered[i];
    const auto rank = std::find(formats.begin(), formats.end(), mode.getPixelFormat());
    if (rank == formats.end()) {
      unread.insert(nameOf(mode.getPixelFormat()));
      continue;
    }
    sizes.insert(sizeText(mode.getResolutionX(), mode.getResolutionY()));
    if (mode.getResolutionX() != wanted.width_px || mode.getResolutionY() != wanted.height_px) continue;
    if (best == nullptr || rank < best_rank || (rank == best_rank && mode.getFps() > best->getFps())) {
      best = &mode;
      best_rank = rank;
    }
  }
  if (best != nullptr) return *best;
  std::string list;
  for (const std::string& size : sizes) list += (list.empty() ? "" : ", ") + size;
  if (list.empty()) {
    for (const std::string& format : unread) list += (list.empty() ? "" : ", ") + format;
    refuse(name + " comes only in formats that are not read here: " + list + ".");
  }
  refuse(name + " has no images of " + sizeText(wanted.width_px, wanted.height_px) +
         " pixels; the device offers " + list + ". Change width_px and height_px in the cell file.");
}

}  // namespace

OpenNiStream::OpenNiStream(openni::Device& device, const sensor::StreamMode& wanted,
                           const std::string& camera, bool raw_infrared)
    : kind_(wanted.stream), camera_(camera), raw_infrared_(raw_infrared) {
  const openni::SensorType type = sensorOf(kind_);
  const openni::SensorInfo* const info = device.getSensorInfo(type);
  if (info == nullptr) {
    refuse(name() +
           ": the device has no such stream, says its OpenNI2 driver. Correct the cell file, or use the "
           "driver that belongs to the camera.");
  }
  mode_ = chooseMode(*info, wanted, name());
  if (stream_.create(device, type) != openni::STATUS_OK)
    refuse(name() + " does not open: " + lastError() + ".");
  if (stream_.setVideoMode(mode_) != openni::STATUS_OK) {
    refuse(name() + " refuses images of " + sizeText(wanted.width_px, wanted.height_px) + ": " + lastError() +
           ".");
  }
  (void)stream_.setMirroringEnabled(false);
  // A driver that cannot tell does not mirror.
  if (stream_.getMirroringEnabled()) {
    refuse(name() +
           " is mirrored and its driver cannot change that: a mirrored camera cannot be calibrated.");
  }
  if (stream_.isCroppingSupported()) (void)stream_.resetCropping();
}

OpenNiStream::~OpenNiStream() {
  stop();
  stream_.destroy();
}

std::string OpenNiStream::name() const { return "Camera '" + camera_ + "', " + toString(kind_); }

void OpenNiStream::start() {
  if (running_) return;
  if (stream_.start() != openni::STATUS_OK) {
    const std::string why = lastError();
    refuse(name() + " does not start" + (why.empty() ? "" : " (" + why + ")") +
           ". If the device cannot run color and infrared at once, say 'excludes_color: true' in the cell "
           "file; else "
           "another program may have it, or the USB port lacks bandwidth (servocal-devices tells).");
  }
  running_ = true;
  if (exposure_locked_) (void)lockExposure();
}

void OpenNiStream::stop() {
  if (running_) stream_.stop();
  running_ = false;
}

std::optional<sensor::DeviceStream::Image> OpenNiStream::newest() {
  constexpr int kAtOnce =
      4;  // More than the library keeps: it ends if frames come faster than they are read.
  openni::VideoFrameRef frame;
  for (int i = 0; i < kAtOnce; ++i) {
    openni::VideoStream* streams[] = {&stream_};
    int ready = -1;
    if (openni::OpenNI::waitForAnyStream(streams, 1, &ready, openni::TIMEOUT_NONE) != openni::STATUS_OK)
      break;
    openni::VideoFrameRef newer;
    if (stream_.readFrame(&newer) != openni::STATUS_OK || !newer.isValid()) break;
    frame = newer;
  }
  if (!frame.isValid()) return std::nullopt;
  Image image;
  image.device_stamp_s = 1e-6 * static_cast<double>(frame.getTimestamp());
  image.number = static_cast<std::uint64_t>(std::max(0, frame.getFrameIndex()));
  image.pixels = imageOf(frame.getVideoMode().getPixelFormat(), frame.getWidth(), frame.getHeight(),
                         frame.getStrideInBytes(), frame.getData());
  if (kind_ == Stream::kInfrared && !raw_infrared_ && image.pixels.depth() == CV_16U)
    image.pixels = sensor::infraredToEightBits(image.pixels);
  return image;
}

std::string OpenNiStream::lockExposure() {
  openni::CameraSettings* const settings = stream_.getCameraSettings();
  if (settings == nullptr || !settings->isValid()) return "its driver has no such settings";
  exposure_locked_ = true;
  std::string failed;
  if (settings->setAutoExposureEnabled(false) != openni::STATUS_OK) failed = "exposure";
  if (settings->setAutoWhiteBalanceEnabled(false) != openni::STATUS_OK)
    failed += failed.empty() ? "white balance" : " and white balance";
  return failed.empty() ? failed : "its driver refuses to lock " + failed;
}

}  // namespace servocal::openni2
