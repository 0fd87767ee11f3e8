// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <OpenNI.h>

#include <cstdint>
#include <optional>
#include <string>

#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"
#include "servocal/sensor/stamp_clock.h"

namespace servocal::openni2 {

/// One stream of an open device.
class DeviceStream {
 public:
  /// Creates the stream at the mode `wanted` (its rate does not count), not mirrored, not cropped, not
  /// running.
  /// @throws Error (kHardwareAbsent) if the device has no such stream or mode; `camera` names it.
  DeviceStream(openni::Device& device, const sensor::StreamMode& wanted, const std::string& camera);
  ~DeviceStream();
  DeviceStream(const DeviceStream&) = delete;
  DeviceStream& operator=(const DeviceStream&) = delete;

  double rateHz() const { return mode_.getFps(); }
  bool isRunning() const { return running_; }
  /// @throws Error (kHardwareAbsent) if the device refuses.
  void start();
  void stop();

  /// The newest frame that has come since the last call, if any: pixels, device stamp and the device's
  /// number. Does not wait.
  std::optional<openni::VideoFrameRef> newest();

  /// What is set and cannot be; empty: all right. Of a color stream.
  std::string lockExposure();

 private:
  std::string name() const;

  openni::VideoStream stream_;
  openni::VideoMode mode_;
  Stream kind_;
  std::string camera_;
  bool running_ = false;
};

}  // namespace servocal::openni2
