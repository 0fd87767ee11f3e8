// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <OpenNI.h>

#include <optional>
#include <string>

#include "servocal/sensor/device_streams.h"

namespace servocal::openni2 {

/// One stream of an open device.
class OpenNiStream final : public sensor::DeviceStream {
 public:
  /// Creates the stream at the mode `wanted` (its rate does not count), not mirrored, not cropped, not
  /// running.
  /// @throws Error (kHardwareAbsent) if the device has no such stream or mode; `camera` names it.
  OpenNiStream(openni::Device& device, const sensor::StreamMode& wanted, const std::string& camera,
               bool raw_infrared);
  ~OpenNiStream() override;
  OpenNiStream(const OpenNiStream&) = delete;
  OpenNiStream& operator=(const OpenNiStream&) = delete;

  double rateHz() const { return mode_.getFps(); }
  openni::VideoStream& native() { return stream_; }
  bool isRunning() const override { return running_; }
  void start() override;
  void stop() override;
  std::optional<Image> newest() override;

  /// Keeps exposure and white balance as they are, also when the stream starts again; says what the driver
  /// refuses, empty: nothing. Of a color stream.
  std::string lockExposure();

 private:
  std::string name() const;

  openni::VideoStream stream_;
  openni::VideoMode mode_;
  Stream kind_;
  std::string camera_;
  bool raw_infrared_;
  bool running_ = false;
  bool exposure_locked_ = false;
};

}  // namespace servocal::openni2
