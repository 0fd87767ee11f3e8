// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "servocal/core/clock.h"
#include "servocal/robot/guard.h"

namespace servocal::servo {

/// Between two commands. Frames come slower; in between the view is predicted.
constexpr Duration kTick = std::chrono::milliseconds(8);
/// 1/s; gain at the end of a move that the arm's own pose report closes.
constexpr double kRobotGain = 12.0;
/// A drive ends after the guard has refused for so long.
constexpr Duration kRefusedFor = std::chrono::milliseconds(500);

/// Stops the arm however the scope is left, exceptions of devices included.
class StopOnExit {
 public:
  explicit StopOnExit(robot::Guard& guard) : guard_(guard) {}
  ~StopOnExit() {
    try {
      guard_.stopNow();
    } catch (...) {  // The arm is gone; its watchdog stops it.
    }
  }
  StopOnExit(const StopOnExit&) = delete;
  StopOnExit& operator=(const StopOnExit&) = delete;

 private:
  robot::Guard& guard_;
};

/// Notices when the guard refuses for long.
class RefusalTimer {
 public:
  bool lasted(const robot::GuardVerdict& verdict, Instant now) {
    if (!verdict.refused() || !refusing_) since_ = now;
    refusing_ = verdict.refused();
    return now - since_ >= kRefusedFor;
  }
  void reset() { refusing_ = false; }

 private:
  bool refusing_ = false;
  Instant since_{};
};

}  // namespace servocal::servo
