// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "servocal/core/clock.h"

namespace servocal::servo {

/// Notices an error in the image that grows although the arm obeys. A law with a mount wrong by up to 45
/// degrees makes detours; one with a wrong sign or frame runs away.
class DivergenceWatch {
 public:
  /// Once per frame, others are ignored. True if the error has grown far beyond its least value, over so many
  /// frames since then during which the arm moved as told.
  bool grew(Instant frame, double error_px, bool moved) {
    if (frame_ == frame) return false;
    frame_ = frame;
    if (!least_px_ || error_px < *least_px_) {
      least_px_ = error_px;
      frames_ = 0;
    }
    if (moved) ++frames_;
    return frames_ >= kFrames && error_px > kGrowth * *least_px_ + kGrowthPx;
  }
  double leastPx() const { return least_px_.value_or(0.0); }
  void reset() { *this = {}; }

 private:
  static constexpr int kFrames = 8;
  static constexpr double kGrowth = 1.5;
  static constexpr double kGrowthPx = 40.0;
  std::optional<Instant> frame_;
  std::optional<double> least_px_;
  int frames_ = 0;
};

}  // namespace servocal::servo
