// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>

namespace servocal {

/// Marks the time line of one run; see Clock.
struct RunClock {
  using duration = std::chrono::nanoseconds;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<RunClock>;
  static constexpr bool is_steady = true;
};

using Duration = RunClock::duration;
using Instant = RunClock::time_point;  ///< Since the start of the run.

inline double toSeconds(Duration duration) { return std::chrono::duration<double>(duration).count(); }
inline double toSeconds(Instant instant) { return toSeconds(instant.time_since_epoch()); }
inline Duration fromSeconds(double seconds) {
  return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(seconds));
}

/// The run's only source of time. Nobody sleeps or asks the time by any other way, so a simulated
/// run is deterministic and as fast as the machine allows.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual Instant now() const = 0;
  /// Returns at once if `instant` has passed.
  virtual void sleepUntil(Instant instant) = 0;
  void sleepFor(Duration duration) { sleepUntil(now() + duration); }
};

/// Monotonic wall time, zero at construction.
class WallClock final : public Clock {
 public:
  WallClock();
  Instant now() const override;
  void sleepUntil(Instant instant) override;

 private:
  std::chrono::steady_clock::time_point start_;
};

/// Time that passes only when somebody sleeps. For one thread.
class SimulatedClock final : public Clock {
 public:
  Instant now() const override { return now_; }
  void sleepUntil(Instant instant) override {
    if (instant > now_) now_ = instant;
  }

 private:
  Instant now_{};
};

}  // namespace servocal
