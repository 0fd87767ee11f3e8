// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "servocal/core/clock.h"

namespace servocal::sensor {

struct StampClockOptions {
  Duration nominal_latency =
      std::chrono::milliseconds(65);  ///< Device stamp to arrival when nothing is in the way.
  double max_drift_ppm = 200.0;       ///< Of the device's clock against the run's.
  double wrap_s = 0.0;                ///< The device's stamps begin again after so many seconds; 0: never.
  Duration jump = std::chrono::milliseconds(50);  ///< A step of the device's clock is at least so large.
  Duration late_for = std::chrono::seconds(2);    ///< Later than `jump` for so long is a step, not a jam.
};

enum class StampEvent {
  kSteady,   ///< As expected; or a little late.
  kFirst,    ///< Nothing to compare with yet.
  kLate,     ///< Arrived more than `jump` later than usual; its stamp is still that of its exposure.
  kWrapped,  ///< The device's counter began again, as it was said to.
  kReset,    ///< The device's stamps went back, by more than `jump`: estimated anew.
  kJumped,   ///< The device's clock was set ahead, or back behind what a jam explains: estimated anew.
};
const char* toString(StampEvent event);

/// Turns the stamps of a device into instants of the run's clock.
///
/// Transport only ever delays: the least of "received - device stamp" is the offset of the two clocks plus
/// the nominal latency. The least is let grow by max_drift_ppm, so that it follows a device clock that runs
/// slow; one that runs fast lowers it by itself. Between two frames that came through without delay the stamp
/// is thus late by at most max_drift_ppm times the time between them.
class StampClock {
 public:
  struct Reading {
    Instant stamp{};
    StampEvent event = StampEvent::kFirst;
  };

  /// @throws std::invalid_argument for a negative drift, wrap, or latency, or a jump that is not positive.
  explicit StampClock(const StampClockOptions& options = {});
  /// In the order of arrival.
  /// @throws std::invalid_argument if the stamp is not finite.
  Reading read(double device_stamp_s, Instant received);
  /// Run's clock minus device's clock, s; nothing before the first stamp.
  std::optional<double> offsetS() const;

 private:
  Reading restart(double least_s, double device_s, Instant received, StampEvent event);

  StampClockOptions options_;
  std::optional<double> least_s_;  // Of received - device stamp.
  Instant updated_{};
  double last_device_s_ = 0.0;
  double unwrapped_s_ = 0.0;  // Added for the counter's turns.
  std::optional<Instant> late_since_;
  double least_late_s_ = 0.0;  // As least_s_, of those that came late in a row.
};

}  // namespace servocal::sensor
