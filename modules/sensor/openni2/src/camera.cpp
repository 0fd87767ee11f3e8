// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor_openni2/camera.h"

#include <optional>
#include <utility>
#include <vector>

#include "find_device.h"
#include "library.h"
#include "openni_stream.h"
#include "recorder.h"
#include "servocal/core/error.h"
#include "servocal/sensor/device_streams.h"

namespace servocal::openni2 {
namespace {

std::vector<sensor::StreamMode> modesOf(const CameraConfig& config) {
  std::vector<sensor::StreamMode> modes;
  const bool exclusive = config.infrared && config.infrared->excludes_color;
  modes.push_back({Stream::kColor, config.width_px, config.height_px, 0.0, exclusive});
  if (!config.infrared) return modes;
  modes.push_back({Stream::kInfrared, config.infrared->width_px, config.infrared->height_px, 0.0, exclusive});
  if (config.infrared->depth)
    modes.push_back({Stream::kDepth, modes[1].width_px, modes[1].height_px, 0.0, exclusive});
  return modes;
}

class DeviceCamera final : public sensor::RgbdCamera {
 public:
  DeviceCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options)
      : library_(Library::instance()), clock_(clock), options_(options),
        streams_(config.name, clock, config.infrared && config.infrared->excludes_color,
                 {fromSeconds(config.latency_s)}) {
    info_.name = config.name;
    info_.streams = modesOf(config);
    open(findDevice(*library_, config));
  }
  ~DeviceCamera() override { close(); }

  const sensor::CameraInfo& info() const override { return info_; }
  const std::vector<std::string>& notes() const { return notes_; }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override {
    return streams_.next(stream, deadline, [this] { demandPresence(); });
  }

 private:
  void open(const Device& device);
  void close();
  void couple();
  void record(const std::vector<OpenNiStream*>& streams);
  void lockExposure();
  void demandPresence();

  std::shared_ptr<Library> library_;
  Clock& clock_;
  OpenOptions options_;
  sensor::CameraInfo info_;
  Device device_info_;
  openni::Device device_;
  sensor::DeviceStreams streams_;
  OpenNiStream* color_ = nullptr;  ///< One of them.
  std::optional<Recorder> recorder_;
  std::vector<std::string> notes_;
  bool exposure_locked_ = false;
};

void DeviceCamera::open(const Device& device) {
  device_info_ = device;
  if (device_.open(device.uri.c_str()) != openni::STATUS_OK) {
    throw Error(ErrorKind::kHardwareAbsent,
                "Camera '" + info_.name + "' (" + describe(device) + ") does not open: " + lastError() +
                    ". Another program may have it, or this user may not (servocal-devices tells).");
  }
  info_.model = device.vendor.empty() ? device.name : device.vendor + " " + device.name;
  info_.serial = device.serial;
  std::vector<OpenNiStream*> all;
  for (sensor::StreamMode& mode : info_.streams) {
    auto stream = std::make_unique<OpenNiStream>(device_, mode, info_.name, options_.raw_infrared);
    mode.rate_hz = stream->rateHz();
    all.push_back(stream.get());
    if (mode.stream == Stream::kColor) color_ = stream.get();
    streams_.set(mode.stream, std::move(stream));
  }
  notes_.clear();
  if (device_.isImageRegistrationModeSupported(openni::IMAGE_REGISTRATION_DEPTH_TO_COLOR)) {
    (void)device_.setImageRegistrationMode(openni::IMAGE_REGISTRATION_OFF);
  }
  if (device_.getImageRegistrationMode() != openni::IMAGE_REGISTRATION_OFF) {
    throw Error(ErrorKind::kHardwareAbsent,
                "Camera '" + info_.name +
                    "': its driver maps depth to the color image "
                    "and cannot be kept from it; such depth cannot be calibrated.");
  }
  couple();
  if (!options_.record.empty()) {
    record(all);
  }
  if (options_.lock_exposure) lockExposure();
}

void DeviceCamera::close() {
  recorder_.reset();
  streams_.drop();
  device_.close();
}

/// Whether the device can expose color and depth together is only known while both run.
void DeviceCamera::couple() {
  const bool has_depth = info_.streams.back().stream == Stream::kDepth;
  if (!has_depth || info_.streams.front().exclusive) return;
  streams_.activate(Stream::kColor);
  streams_.activate(Stream::kDepth);
  if (device_.setDepthColorSyncEnabled(true) != openni::STATUS_OK) {
    (void)device_.setDepthColorSyncEnabled(false);
    notes_.push_back("color and depth are not exposed together: the device does not offer that");
  }
  streams_.stopAll();
}

void DeviceCamera::record(const std::vector<OpenNiStream*>& streams) {
  recorder_.emplace(options_.record);
  for (std::size_t i = 0; i < streams.size(); ++i) {
    if (canBePlayed(streams[i]->native().getVideoMode())) {
      recorder_->attach(streams[i]->native());
    } else {
      const sensor::StreamMode& mode = info_.streams[i];
      notes_.push_back(std::string(toString(mode.stream)) + " is not recorded: OpenNI2's player does not take frames of " +
                       std::to_string(mode.width_px) + " x " + std::to_string(mode.height_px) + " pixels");
    }
  }
  recorder_->start();
}

void DeviceCamera::lockExposure() {
  streams_.activate(Stream::kColor);
  if (!exposure_locked_) {  // After a replug at once: the board may be anywhere in the image now.
    const Instant until = clock_.now() + options_.settle;
    while (clock_.now() < until) (void)next(Stream::kColor, until);
  }
  const std::string failed = color_->lockExposure();
  if (!failed.empty()) notes_.push_back("exposure and white balance are not locked: " + failed);
  exposure_locked_ = true;
}

/// Throws while the device is away; opens it again once it is back.
void DeviceCamera::demandPresence() {
  if (library_->isPlugged(device_info_.uri) && device_.isValid()) return;
  close();
  for (const Device& candidate : library_->devices()) {
    if (!options_.record.empty()) break;  // Its file has ended.
    const bool same = device_info_.serial.empty() ? candidate.uri == device_info_.uri
                                                  : candidate.serial == device_info_.serial;
    if (!same) continue;
    try {
      open(candidate);
    } catch (...) {
      close();  // Half of it is of no use; the next call tries again.
      throw;
    }
    return;
  }
  throw Error(ErrorKind::kHardwareAbsent,
              "Camera '" + info_.name + "' (" + describe(device_info_) +
                  ") is gone: it was unplugged, or lost its power. Plug it in again; it "
                  "is known by its " +
                  (device_info_.serial.empty() ? "address" : "serial number") + ".");
}

}  // namespace

OpenedCamera openCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options) {
  auto camera = std::make_unique<DeviceCamera>(config, clock, options);
  OpenedCamera opened;
  opened.notes = camera->notes();
  opened.notes.push_back(
      "not run on a real camera through OpenNI2: tested with our own driver only (docs/limits.md)");
  opened.camera = std::move(camera);
  return opened;
}

}  // namespace servocal::openni2
