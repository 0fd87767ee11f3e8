// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"
#include "servocal/sensor/stamp_clock.h"

namespace servocal::sensor {

/// One stream of an open device, as its driver knows it.
class DeviceStream {
 public:
  struct Image {
    cv::Mat pixels;  ///< As Frame::image.
    double device_stamp_s = 0.0;
    std::uint64_t number = 0;         ///< The driver's; may begin again whenever the stream starts.
    std::optional<Instant> received;  ///< When the driver got it; nothing if it cannot tell.
  };

  virtual ~DeviceStream() = default;
  virtual bool isRunning() const = 0;
  /// @throws Error (kHardwareAbsent) if the device refuses.
  virtual void start() = 0;
  virtual void stop() = 0;
  /// The newest image that has come since the last call, if any. Does not wait.
  virtual std::optional<Image> newest() = 0;
};

/// The streams of one device as RgbdCamera::next() hands them out, for backends: exclusive streams take
/// turns, stamps are put on the run's clock, numbers go on rising when a stream or the device begins anew.
///
/// Waiting is sleeping on the clock in steps of a millisecond, so a simulated run waits for no wall time.
class DeviceStreams {
 public:
  /// Exclusive: color and the infrared side (infrared and depth) never run at once, and of them only frames
  /// are handed out that were exposed after the change. `clock` must outlive it.
  DeviceStreams(std::string camera, Clock& clock, bool exclusive, const StampClockOptions& stamps);

  /// A stream of the device that was opened; in the place of the one before, if it was opened again.
  void set(Stream kind, std::unique_ptr<DeviceStream> stream);
  /// Before the device is closed.
  void drop();
  /// Runs the stream; stops those that it excludes.
  void activate(Stream kind);
  void stopAll();

  /// RgbdCamera::next(). `demand_presence` opens a device again that is back, or throws while it is away.
  std::optional<Frame> next(Stream kind, Instant deadline, const std::function<void()>& demand_presence);

 private:
  /// What outlives the device: its clock's relation to ours, and where its numbers stand.
  struct Eye {
    std::unique_ptr<DeviceStream> device;
    StampClock stamps;
    bool is_related = false;  ///< A frame whose arrival is known has been seen.
    Instant started{};
    std::uint64_t base = 0;      ///< Added to the device's numbers.
    std::uint64_t sequence = 0;  ///< Of the last frame.
  };

  bool excludes(Stream one, Stream other) const {
    return exclusive_ && (one == Stream::kColor) != (other == Stream::kColor);
  }
  Eye& eye(Stream kind);
  std::optional<Frame> newest(Stream kind, bool waited);

  std::string camera_;
  Clock& clock_;
  bool exclusive_;
  StampClockOptions stamp_options_;
  std::map<Stream, Eye> eyes_;
};

}  // namespace servocal::sensor
