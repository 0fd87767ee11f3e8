// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <array>
#include <limits>

#include "servocal/core/clock.h"

namespace servocal::robot::ur {

/// Takes the controller's stamps to the run's clock. A package never arrives before it was made, so the least
/// "arrival minus stamp" of the last seconds is the offset of the clocks, up to the shortest way through the
/// network (a fraction of a millisecond on a cable). The window lets the offset follow drift.
class StampMap {
 public:
  /// To be called once per package. Stamps never run backwards and are never later than `arrival`.
  Instant map(double stamp_s, Instant arrival) {
    const double offset = toSeconds(arrival) - stamp_s;
    if (stamp_s >= bucket_end_s_) {
      std::rotate(least_.begin(), least_.begin() + 1, least_.end());
      least_.back() = std::numeric_limits<double>::infinity();
      bucket_end_s_ = stamp_s + kBucketS;
    }
    least_.back() = std::min(least_.back(), offset);
    const double least = *std::min_element(least_.begin(), least_.end());
    last_ = std::max(last_, Instant(fromSeconds(stamp_s + least)));
    return last_ = std::min(last_, arrival);
  }

 private:
  static constexpr double kBucketS = 1.0;
  std::array<double, 4> least_ = {
      std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(),
      std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  double bucket_end_s_ = -std::numeric_limits<double>::infinity();
  Instant last_{};
};

}  // namespace servocal::robot::ur
