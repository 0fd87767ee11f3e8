// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "driver_api.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::sim_openni2_driver {

/// One stream of a served camera.
class ServedStream final : public oni::driver::StreamBase {
 public:
  /// @param is_allowed whether this stream may start now; @param modes what the device offers, the first one
  /// runs.
  ServedStream(Stream stream, std::vector<OniVideoMode> modes);

  OniStatus start() override;
  void stop() override { running_ = false; }
  bool isRunning() const { return running_; }
  Stream stream() const { return stream_; }
  /// Another running stream that excludes this one makes start() fail.
  void setRivals(const std::vector<const ServedStream*>& rivals) { rivals_ = rivals; }

  OniStatus setProperty(int id, const void* data, int size) override;
  OniStatus getProperty(int id, void* data, int* size) override;
  OniBool isPropertySupported(int id) override;

  void push(const sensor::Frame& frame);

 private:
  bool isColor() const { return stream_ == Stream::kColor; }

  Stream stream_;
  std::vector<OniVideoMode> modes_;
  OniVideoMode mode_;
  std::vector<const ServedStream*> rivals_;
  bool running_ = false;
  OniBool mirrored_ = TRUE;  // As most devices come up.
  OniBool auto_exposure_ = TRUE;
  OniBool auto_white_balance_ = TRUE;
};

}  // namespace servocal::sim_openni2_driver
