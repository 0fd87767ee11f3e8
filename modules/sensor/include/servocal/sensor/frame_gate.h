// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::sensor {

struct FrameGateOptions {
  Duration max_age = std::chrono::milliseconds(500);  ///< Exposure to now.
};

enum class FrameFate {
  kAccepted,
  kOutOfDate,   ///< Older than max_age.
  kDuplicate,   ///< The stamp of the frame before.
  kReordered,   ///< Stamped before a frame that came earlier.
  kFromFuture,  ///< Stamped after now: the clocks do not fit.
  kFrozen,      ///< The content of the frame before under a new stamp. Sensors are never so quiet.
};
const char* toString(FrameFate fate);

/// How often each fate befell the frames of one stream.
struct FrameCounts {
  int accepted = 0;
  int out_of_date = 0;
  int duplicate = 0;
  int reordered = 0;
  int from_future = 0;
  int frozen = 0;

  int dropped() const { return out_of_date + duplicate + reordered + from_future + frozen; }
  /// For the operator: "3 out of date, 1 frozen of 120 frames"; "120 frames" if none was dropped.
  std::string text() const;
};

/// Judges the frames of one stream in the order of their arrival.
class FrameGate {
 public:
  explicit FrameGate(const FrameGateOptions& options = {}) : options_(options) {}
  FrameFate judge(const Frame& frame, Instant now);
  const FrameCounts& counts() const { return counts_; }

 private:
  FrameGateOptions options_;
  FrameCounts counts_;
  std::optional<Instant> newest_;
  std::optional<std::uint64_t> content_;  // Of the frame before.
};

/// A camera whose bad frames are dropped and counted.
class GatedCamera final : public RgbdCamera {
 public:
  /// `camera` and `clock` must outlive it.
  GatedCamera(RgbdCamera& camera, const Clock& clock, const FrameGateOptions& options = {})
      : camera_(camera), clock_(clock), options_(options) {}
  const CameraInfo& info() const override { return camera_.info(); }
  std::optional<Frame> next(Stream stream, Instant deadline) override;
  FrameCounts counts(Stream stream) const;

 private:
  RgbdCamera& camera_;
  const Clock& clock_;
  FrameGateOptions options_;
  std::map<Stream, FrameGate> gates_;
};

/// Of frames of several streams, those that belong together: for the newest frame of the first list that has
/// one near it in every other list, that frame and its nearest ones, in the order of the lists. Nothing if
/// there is none. Robot states go with a frame by Arm::stateAt(stamp).
/// @param tolerance largest difference of two stamps of a set.
std::optional<std::vector<Frame>> pairFrames(const std::vector<std::vector<Frame>>& streams,
                                             Duration tolerance);

}  // namespace servocal::sensor
