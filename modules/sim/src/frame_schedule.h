// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>

#include "servocal/core/clock.h"
#include "servocal/core/simulation.h"

namespace servocal::sim {

/// When a free-running sensor exposes and delivers. Frame k is exposed from phase + k / rate on and delivered
/// a latency after its end, plus a jitter of its own.
class FrameSchedule {
 public:
  FrameSchedule(const SimulatedSensorConfig& sensor, double phase_s, double extra_latency_s, double jitter_s,
                std::uint64_t jitter_seed);

  /// An instant of frame k's exposure; 0 its begin, 1 its end.
  Instant exposed(std::int64_t k, double fraction) const;
  Instant delivered(std::int64_t k) const;
  /// The newest frame that is there; -1: none yet.
  std::int64_t newestDelivered(Instant now) const;
  /// The first frame whose exposure begins at this instant or later.
  std::int64_t firstExposedFrom(Instant instant) const;
  double rateHz() const { return rate_hz_; }

 private:
  double rate_hz_;
  double exposure_s_;
  double latency_s_;
  double phase_s_;
  double jitter_s_;
  std::uint64_t jitter_seed_;
};

}  // namespace servocal::sim
