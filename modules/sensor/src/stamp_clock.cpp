// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor/stamp_clock.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace servocal::sensor {

const char* toString(StampEvent event) {
  switch (event) {
    case StampEvent::kSteady: return "steady";
    case StampEvent::kFirst: return "first";
    case StampEvent::kLate: return "late";
    case StampEvent::kWrapped: return "wrapped";
    case StampEvent::kReset: return "reset";
    case StampEvent::kJumped: return "jumped";
  }
  return "unknown";
}

StampClock::StampClock(const StampClockOptions& options) : options_(options) {
  if (!(options.max_drift_ppm >= 0.0 && options.wrap_s >= 0.0) ||
      options.nominal_latency < Duration::zero() || options.jump <= Duration::zero() ||
      options.late_for <= Duration::zero())
    throw std::invalid_argument("StampClock: an option is out of range");
}

StampClock::Reading StampClock::restart(double least_s, double device_s, Instant received, StampEvent event) {
  least_s_ = least_s;
  updated_ = received;
  late_since_.reset();
  return {Instant(fromSeconds(device_s + least_s)) - options_.nominal_latency, event};
}

StampClock::Reading StampClock::read(double device_stamp_s, Instant received) {
  if (!std::isfinite(device_stamp_s)) throw std::invalid_argument("StampClock: the stamp is not a number");
  const double jump_s = toSeconds(options_.jump);
  StampEvent event = StampEvent::kSteady;
  if (least_s_ && options_.wrap_s > 0.0 &&
      device_stamp_s + unwrapped_s_ < last_device_s_ - 0.5 * options_.wrap_s) {
    unwrapped_s_ += options_.wrap_s;
    event = StampEvent::kWrapped;
  }
  const double device_s = device_stamp_s + unwrapped_s_;
  const double offset_s = toSeconds(received) - device_s;
  const bool went_back = least_s_ && device_s < last_device_s_ - jump_s;
  last_device_s_ = device_s;
  if (!least_s_) return restart(offset_s, device_s, received, StampEvent::kFirst);
  if (went_back) return restart(offset_s, device_s, received, StampEvent::kReset);
  // Nothing arrives before it was sent.
  if (offset_s < *least_s_ - jump_s) return restart(offset_s, device_s, received, StampEvent::kJumped);

  const double allowed_s =
      *least_s_ + 1e-6 * options_.max_drift_ppm * std::max(0.0, toSeconds(received - updated_));
  if (offset_s <= allowed_s + jump_s) {
    late_since_.reset();
  } else {
    event = StampEvent::kLate;
    least_late_s_ = late_since_ ? std::min(least_late_s_, offset_s) : offset_s;
    if (!late_since_) late_since_ = received;
    if (received - *late_since_ >= options_.late_for)
      return restart(least_late_s_, device_s, received, StampEvent::kJumped);
  }
  least_s_ = std::min(offset_s, allowed_s);
  updated_ = received;
  return {Instant(fromSeconds(device_s + *least_s_)) - options_.nominal_latency, event};
}

std::optional<double> StampClock::offsetS() const {
  if (!least_s_) return std::nullopt;
  return *least_s_ - toSeconds(options_.nominal_latency);
}

}  // namespace servocal::sensor
