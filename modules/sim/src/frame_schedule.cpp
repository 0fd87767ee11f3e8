// SPDX-License-Identifier: GPL-3.0-or-later
#include "frame_schedule.h"

#include <algorithm>
#include <cmath>

#include "random.h"

namespace servocal::sim {

FrameSchedule::FrameSchedule(const SimulatedSensorConfig& sensor, double phase_s, double extra_latency_s,
                             double jitter_s, std::uint64_t jitter_seed)
    : rate_hz_(sensor.rate_hz), exposure_s_(sensor.exposure_s),
      latency_s_(sensor.latency_s + extra_latency_s), phase_s_(phase_s),
      // Frames keep their order.
      jitter_s_(std::min(jitter_s, 0.9 / sensor.rate_hz)), jitter_seed_(jitter_seed) {}

Instant FrameSchedule::exposed(std::int64_t k, double fraction) const {
  const Instant begin(Duration(std::llround(1e9 * (phase_s_ + static_cast<double>(k) / rate_hz_))));
  return begin + fromSeconds(fraction * exposure_s_);
}

Instant FrameSchedule::delivered(std::int64_t k) const {
  const Instant punctual = exposed(k, 0.0) + fromSeconds(exposure_s_ + latency_s_);
  if (jitter_s_ == 0.0) return punctual;
  Random random(jitter_seed_ ^ scramble(static_cast<std::uint64_t>(k)), "jitter");
  return punctual + fromSeconds(random.uniform(0.0, jitter_s_));
}

std::int64_t FrameSchedule::newestDelivered(Instant now) const {
  const double age_s = toSeconds(now) - phase_s_ - exposure_s_ - latency_s_;
  std::int64_t k = std::max<std::int64_t>(-1, static_cast<std::int64_t>(age_s * rate_hz_) + 1);
  while (k >= 0 && delivered(k) > now) --k;
  return k;
}

std::int64_t FrameSchedule::firstExposedFrom(Instant instant) const {
  const double periods = (toSeconds(instant) - phase_s_) * rate_hz_;
  std::int64_t k = std::max<std::int64_t>(0, static_cast<std::int64_t>(periods) - 1);
  while (exposed(k, 0.0) < instant) ++k;
  return k;
}

}  // namespace servocal::sim
