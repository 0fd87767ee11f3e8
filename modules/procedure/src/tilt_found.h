// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <optional>

namespace servocal::procedure {

/// What one direction's search has found out about one stream.
struct TiltFound {
  int seen_deg = 0;             // Largest angle at which it saw the board,
  std::optional<int> lost_deg;  // and smallest beyond that at which it did not. What it missed before was not the tilt's.

  void note(int angle_deg, bool seen) {
    if (seen) {
      seen_deg = std::max(seen_deg, angle_deg);
      if (lost_deg && *lost_deg <= seen_deg) lost_deg.reset();
    } else if (angle_deg > seen_deg) {
      lost_deg = lost_deg ? std::min(*lost_deg, angle_deg) : angle_deg;
    }
  }
};

}  // namespace servocal::procedure
