// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor_openni2/camera.h"

#include <algorithm>
#include <map>
#include <stdexcept>

#include "device_stream.h"
#include "find_device.h"
#include "library.h"
#include "pixels.h"
#include "servocal/core/error.h"
#include "servocal/sensor/infrared.h"

namespace servocal::openni2 {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPoll{1};

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
      : library_(Library::instance()), clock_(clock), options_(options) {
    stamp_options_.nominal_latency = fromSeconds(config.latency_s);
    info_.name = config.name;
    info_.streams = modesOf(config);
    open(findDevice(*library_, config));
  }
  ~DeviceCamera() override { close(); }

  const sensor::CameraInfo& info() const override { return info_; }
  const std::vector<std::string>& notes() const { return notes_; }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override;

 private:
  /// What outlives the device: its clock's relation to ours, and where its numbers stand.
  struct Eye {
    std::unique_ptr<DeviceStream> device;
    sensor::StampClock stamps;
    bool is_related = false;  ///< A frame that was waited for has been seen.
    Instant started{};
    std::uint64_t base = 0;      ///< Added to the device's numbers, which begin again with the stream.
    std::uint64_t sequence = 0;  ///< Of the last frame.
  };

  void open(const Device& device);
  void close();
  void couple();
  void lockExposure();
  void demandPresence();
  void activate(Stream stream);
  std::optional<sensor::Frame> newest(Stream stream, bool waited);
  bool excludes(Stream one, Stream other) const;
  Eye& eye(Stream stream);

  std::shared_ptr<Library> library_;
  Clock& clock_;
  OpenOptions options_;
  sensor::StampClockOptions stamp_options_;
  sensor::CameraInfo info_;
  Device device_info_;
  openni::Device device_;
  std::map<Stream, Eye> eyes_;
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
  for (sensor::StreamMode& mode : info_.streams) {
    Eye& one = eyes_.try_emplace(mode.stream, Eye{nullptr, sensor::StampClock(stamp_options_)}).first->second;
    one.device = std::make_unique<DeviceStream>(device_, mode, info_.name);
    mode.rate_hz = one.device->rateHz();
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
  if (options_.lock_exposure) lockExposure();
}

void DeviceCamera::close() {
  for (auto& [stream, one] : eyes_) one.device.reset();
  device_.close();
}

/// Whether the device can expose color and depth together is only known while both run.
void DeviceCamera::couple() {
  if (eyes_.count(Stream::kDepth) == 0 || info_.streams.front().exclusive) return;
  activate(Stream::kColor);
  activate(Stream::kDepth);
  if (device_.setDepthColorSyncEnabled(true) != openni::STATUS_OK) {
    (void)device_.setDepthColorSyncEnabled(false);
    notes_.push_back("color and depth are not exposed together: the device does not offer that");
  }
  for (auto& [stream, one] : eyes_) one.device->stop();
}

void DeviceCamera::lockExposure() {
  activate(Stream::kColor);
  if (!exposure_locked_) {  // After a replug at once: the board may be anywhere in the image now.
    const Instant until = clock_.now() + options_.settle;
    while (clock_.now() < until) (void)next(Stream::kColor, until);
  }
  const std::string failed = eye(Stream::kColor).device->lockExposure();
  if (!failed.empty()) notes_.push_back("exposure and white balance are not locked: " + failed);
  exposure_locked_ = true;
}

DeviceCamera::Eye& DeviceCamera::eye(Stream stream) {
  const auto found = eyes_.find(stream);
  if (found == eyes_.end()) {
    throw std::invalid_argument("camera '" + info_.name + "' has no " + toString(stream) + " stream");
  }
  return found->second;
}

/// Throws while the device is away; opens it again once it is back.
void DeviceCamera::demandPresence() {
  if (library_->isPlugged(device_info_.uri) && device_.isValid()) return;
  close();
  for (const Device& candidate : library_->devices()) {
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

bool DeviceCamera::excludes(Stream one, Stream other) const {
  return info_.streams.front().exclusive && (one == Stream::kColor) != (other == Stream::kColor);
}

void DeviceCamera::activate(Stream stream) {
  Eye& wanted = eye(stream);
  if (wanted.device->isRunning()) return;
  for (auto& [other, one] : eyes_) {
    if (excludes(stream, other)) one.device->stop();
  }
  wanted.device->start();
  wanted.started = clock_.now();
  wanted.base = wanted.sequence;
  if (stream == Stream::kColor && exposure_locked_) (void)wanted.device->lockExposure();
}

std::optional<sensor::Frame> DeviceCamera::newest(Stream stream, bool waited) {
  Eye& from = eye(stream);
  const auto raw = from.device->newest();
  if (!raw) return std::nullopt;
  const Instant received = clock_.now();
  // One that lay there already says nothing about how long it took: it must not relate the clocks.
  if (!from.is_related && !waited) return std::nullopt;
  from.is_related = true;
  sensor::Frame frame;
  frame.stream = stream;
  frame.received = received;
  frame.device_stamp_s = 1e-6 * static_cast<double>(raw->getTimestamp());
  frame.stamp = from.stamps.read(frame.device_stamp_s, received).stamp;
  // Exposed before the stream was switched on: left over from the time before, or still settling.
  if (info_.streams.front().exclusive && frame.stamp < from.started) return std::nullopt;
  auto number = from.base + static_cast<std::uint64_t>(std::max(0, raw->getFrameIndex()));
  if (number <= from.sequence) {
    from.base += from.sequence + 1 - number;
    number = from.sequence + 1;
  }
  frame.sequence = from.sequence = number;
  frame.image = imageOf(raw->getVideoMode().getPixelFormat(), raw->getWidth(), raw->getHeight(),
                        raw->getStrideInBytes(), raw->getData());
  if (stream == Stream::kInfrared && !options_.raw_infrared && frame.image.depth() == CV_16U) {
    frame.image = sensor::infraredToEightBits(frame.image);
  }
  return frame;
}

std::optional<sensor::Frame> DeviceCamera::next(Stream stream, Instant deadline) {
  (void)eye(stream);
  demandPresence();
  activate(stream);
  for (bool waited = false;; waited = true) {
    if (auto frame = newest(stream, waited)) return frame;
    if (clock_.now() >= deadline) return std::nullopt;
    clock_.sleepUntil(std::min(deadline, clock_.now() + kPoll));
    demandPresence();
    activate(stream);
  }
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
