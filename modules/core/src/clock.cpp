// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/clock.h"

#include <thread>

namespace servocal {

WallClock::WallClock() : start_(std::chrono::steady_clock::now()) {}

Instant WallClock::now() const {
  return Instant(std::chrono::duration_cast<Duration>(std::chrono::steady_clock::now() - start_));
}

void WallClock::sleepUntil(Instant instant) {
  std::this_thread::sleep_until(start_ + instant.time_since_epoch());
}

}  // namespace servocal
