// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <optional>
#include <utility>

#include "servocal/sensor/rgbd_camera.h"

namespace servocal::test {

/// A camera between whose frames and their user somebody stands.
class SpoiledCamera final : public sensor::RgbdCamera {
 public:
  using Spoil = std::function<void(sensor::Frame&)>;
  /// `camera` must outlive it. `info` is what it says of itself.
  SpoiledCamera(sensor::RgbdCamera& camera, Spoil spoil, sensor::CameraInfo info)
      : camera_(camera), spoil_(std::move(spoil)), info_(std::move(info)) {}
  SpoiledCamera(sensor::RgbdCamera& camera, Spoil spoil)
      : SpoiledCamera(camera, std::move(spoil), camera.info()) {}

  const sensor::CameraInfo& info() const override { return info_; }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override {
    auto frame = camera_.next(stream, deadline);
    if (frame) spoil_(*frame);
    return frame;
  }

 private:
  sensor::RgbdCamera& camera_;
  Spoil spoil_;
  sensor::CameraInfo info_;
};

/// All grays of the frame times `gain`, as another exposure or another light makes them.
inline void expose(sensor::Frame& frame, double gain) { frame.image.convertTo(frame.image, -1, gain, 0.0); }

}  // namespace servocal::test
