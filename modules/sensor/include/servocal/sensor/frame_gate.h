// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"
#include "servocal/sensor/stamp_clock.h"

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
  /// Stamps mean something else from now on: the next one is not compared with those before.
  void restamped() { newest_.reset(); }

 private:
  FrameGateOptions options_;
  FrameCounts counts_;
  std::optional<Instant> newest_;
  std::optional<std::uint64_t> content_;  // Of the frame before.
};

/// A camera by the run's clock: stamps are made from the device's own, one StampClock per stream, what is
/// known to be wrong with them is taken off, and bad frames are dropped and counted. It also knows how fast
/// frames really come.
class GatedCamera final : public RgbdCamera {
 public:
  /// `camera` and `clock` must outlive it. Without `stamps` the frames keep those they come with.
  GatedCamera(RgbdCamera& camera, const Clock& clock, const FrameGateOptions& options = {},
              const std::optional<StampClockOptions>& stamps = std::nullopt)
      : camera_(camera), clock_(clock), options_(options), stamps_(stamps) {}
  const CameraInfo& info() const override { return camera_.info(); }
  /// @throws Error (kHardwareAbsent) also if the image is not of the size that info() says: no detection of
  /// it
  ///   would fit those before.
  std::optional<Frame> next(Stream stream, Instant deadline) override;
  /// Stamps of the stream turned out to be so much too late, in all; taken off from now on.
  void setOffset(Stream stream, double offset_s);
  FrameCounts counts(Stream stream) const;
  /// Frames per second of the stream, over the last 30 that were waited for as soon as the one before was
  /// there (a program too busy to fetch them says nothing of the camera). Nothing before that, or if info()
  /// names no rate.
  std::optional<double> measuredRateHz(Stream stream) const;
  /// A sentence for the operator if that is less than half of what info() says.
  std::optional<std::string> slowness(Stream stream) const;

 private:
  struct Watch {
    FrameGate gate;
    std::optional<StampClock> clock;
    double offset_s = 0.0;
    std::optional<Instant> last_stamp, last_received;
    int waited = 0;      ///< Frames that were waited for from the one before on,
    double gap_s = 0.0;  ///< and how far the last of them were apart, on average.
  };
  const StreamMode* mode(Stream stream) const;
  void checkSize(const Frame& frame) const;
  void measureRate(Watch& by, const Frame& frame, Instant asked) const;
  Watch& watch(Stream stream);

  RgbdCamera& camera_;
  const Clock& clock_;
  FrameGateOptions options_;
  std::optional<StampClockOptions> stamps_;
  std::map<Stream, Watch> watches_;
};

/// Of frames of several streams, those that belong together: for the newest frame of the first list that has
/// one near it in every other list, that frame and its nearest ones, in the order of the lists. Nothing if
/// there is none. Robot states go with a frame by Arm::stateAt(stamp).
/// @param tolerance largest difference of two stamps of a set.
std::optional<std::vector<Frame>> pairFrames(const std::vector<std::vector<Frame>>& streams,
                                             Duration tolerance);

}  // namespace servocal::sensor
