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
  /// `camera` must outlive it.
  SpoiledCamera(sensor::RgbdCamera& camera, Spoil spoil) : camera_(camera), spoil_(std::move(spoil)) {}

  const sensor::CameraInfo& info() const override { return camera_.info(); }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override {
    auto frame = camera_.next(stream, deadline);
    if (frame) spoil_(*frame);
    return frame;
  }

 private:
  sensor::RgbdCamera& camera_;
  Spoil spoil_;
};

}  // namespace servocal::test
