// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor_freenect/camera.h"

#include <utility>

#include "find_device.h"
#include "kinect.h"
#include "servocal/core/error.h"
#include "servocal/sensor/device_streams.h"
#include "servocal/sensor/infrared.h"

namespace servocal::freenect {
namespace {

[[noreturn]] void refuse(ErrorKind kind, const CameraConfig& config, const std::string& what) {
  throw Error(kind, "Camera '" + config.name + "'" + what);
}

bool isWide(const CameraConfig& config) { return config.width_px == 1280; }

std::vector<sensor::StreamMode> modesOf(const CameraConfig& config) {
  const auto is = [](int width, int height, int wanted_width, int wanted_height) {
    return width == wanted_width && height == wanted_height;
  };
  if (!is(config.width_px, config.height_px, 640, 480) &&
      !is(config.width_px, config.height_px, 1280, 1024)) {
    refuse(ErrorKind::kInvalidConfig, config,
           ": a Kinect v1 has color of 640 x 480 or 1280 x 1024 pixels only (width_px and height_px).");
  }
  const auto& infrared = config.infrared;
  const bool exclusive = infrared.has_value();
  std::vector<sensor::StreamMode> modes{
      {Stream::kColor, config.width_px, config.height_px, isWide(config) ? 10.0 : 30.0, exclusive}};
  if (!infrared) return modes;
  if (!infrared->excludes_color) {
    refuse(ErrorKind::kInvalidConfig, config,
           ": a Kinect v1 cannot send color and infrared at once: say 'excludes_color: true' in its "
           "'infrared' section.");
  }
  if (!is(infrared->width_px, infrared->height_px, 640, 480)) {
    refuse(
        ErrorKind::kInvalidConfig, config,
        ": infrared and depth of a Kinect v1 have 640 x 480 pixels (width_px and height_px of 'infrared').");
  }
  modes.push_back({Stream::kInfrared, 640, 480, 30.0, exclusive});
  if (infrared->depth) modes.push_back({Stream::kDepth, 640, 480, 30.0, exclusive});
  return modes;
}

/// A stream of a Kinect; the Kinect outlives it.
class KinectStream final : public sensor::DeviceStream {
 public:
  KinectStream(Kinect& kinect, Stream kind, const CameraConfig& config, bool raw_infrared, const bool& lock)
      : kinect_(kinect), kind_(kind), config_(config), raw_infrared_(raw_infrared), lock_exposure_(lock) {}
  ~KinectStream() override { stop(); }

  bool isRunning() const override { return running_; }
  void start() override {
    if (!kinect_.start(kind_, isWide(config_)) && kinect_.alive()) {
      refuse(ErrorKind::kHardwareAbsent, config_,
             std::string(": ") + toString(kind_) + " does not start" + lastError() +
                 ". The USB port may lack bandwidth (servocal-devices tells).");
    }
    running_ = true;
    if (kind_ == Stream::kColor && lock_exposure_) (void)kinect_.lockExposure();
  }
  void stop() override {
    if (running_) kinect_.stop(kind_);
    running_ = false;
  }
  std::optional<Image> newest() override {
    std::optional<Image> image = kinect_.take(kind_);
    if (image && kind_ == Stream::kInfrared && !raw_infrared_)
      image->pixels = sensor::infraredToEightBits(image->pixels);
    return image;
  }

 private:
  Kinect& kinect_;
  Stream kind_;
  const CameraConfig& config_;
  bool raw_infrared_;
  const bool& lock_exposure_;  ///< The camera's: what the sensor forgets when it changes its mode.
  bool running_ = false;
};

class KinectCamera final : public sensor::RgbdCamera {
 public:
  KinectCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options)
      : config_(config), clock_(clock), options_(options),
        streams_(config.name, clock, config.infrared.has_value(), {fromSeconds(config.latency_s)}) {
    info_.name = config.name;
    info_.model = "Microsoft Kinect v1";
    info_.streams = modesOf(config);
    info_.serial = findDevice(config);
    open();
    if (options.lock_exposure) lockExposure();
  }
  ~KinectCamera() override { close(); }

  const sensor::CameraInfo& info() const override { return info_; }
  const std::vector<std::string>& notes() const { return notes_; }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override {
    return streams_.next(stream, deadline, [this] { demandPresence(); });
  }

 private:
  void open() {
    kinect_ = std::make_unique<Kinect>(info_.serial, info_.name, clock_);
    for (const sensor::StreamMode& mode : info_.streams) {
      streams_.set(mode.stream, std::make_unique<KinectStream>(*kinect_, mode.stream, config_,
                                                               options_.raw_infrared, exposure_locked_));
    }
  }
  void close() {
    streams_.drop();
    kinect_.reset();
  }
  void lockExposure() {
    const Instant until = clock_.now() + options_.settle;
    while (clock_.now() < until) (void)next(Stream::kColor, until);
    exposure_locked_ = kinect_->lockExposure();
    if (!exposure_locked_)
      notes_.push_back("exposure and white balance are not locked: libfreenect cannot" + lastError());
  }
  /// Throws while the device is away; opens it again once it is back.
  void demandPresence() {
    if (kinect_ && kinect_->alive()) return;
    close();
    if (!isPlugged(info_.serial)) {
      refuse(
          ErrorKind::kHardwareAbsent, config_,
          " (Kinect v1 " + info_.serial +
              ") is gone: it was unplugged, or lost its power. Plug it in again; it is known by its serial "
              "number.");
    }
    open();
  }

  CameraConfig config_;
  Clock& clock_;
  OpenOptions options_;
  sensor::CameraInfo info_;
  std::vector<std::string> notes_;
  bool exposure_locked_ = false;
  std::unique_ptr<Kinect> kinect_;
  sensor::DeviceStreams streams_;  // Must go before the Kinect.
};

}  // namespace

OpenedCamera openCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options) {
  auto camera = std::make_unique<KinectCamera>(config, clock, options);
  OpenedCamera opened;
  opened.notes = camera->notes();
  opened.notes.push_back(
      "not run on a real Kinect v1: tested with libfreenect's replay of made-up recordings only "
      "(docs/limits.md)");
  opened.camera = std::move(camera);
  return opened;
}

}  // namespace servocal::freenect
