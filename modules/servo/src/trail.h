// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <vector>

#include "servocal/core/pose.h"

namespace servocal::servo {

/// The flange poses of a drive, so that it can go back the way it came.
class Trail {
 public:
  void add(const Pose<Base, EndEffector>& bMe) {
    if (poses_.empty() || distanceM(poses_.back(), bMe) > kSpacingM || angleRad(poses_.back(), bMe) > kSpacingRad)
      poses_.push_back(bMe);
  }
  /// The next pose to go back to; forgets those already reached. Nothing at the start of the trail.
  std::optional<Pose<Base, EndEffector>> back(const Pose<Base, EndEffector>& here) {
    // A little ahead, so that the way back is smooth; but all the way to the first.
    while (poses_.size() > 1 && near(poses_.back(), here, kAheadM, kAheadRad)) poses_.pop_back();
    if (poses_.empty() || (poses_.size() == 1 && near(poses_.front(), here, kThereM, kThereRad)))
      return std::nullopt;
    return poses_.back();
  }

 private:
  static constexpr double kSpacingM = 0.005, kSpacingRad = 0.02;
  static constexpr double kAheadM = 0.02, kAheadRad = 0.06;
  static constexpr double kThereM = 0.001, kThereRad = 0.002;
  static bool near(const Pose<Base, EndEffector>& a, const Pose<Base, EndEffector>& b, double distance_m,
                   double angle_rad) {
    return distanceM(a, b) < distance_m && angleRad(a, b) < angle_rad;
  }
  std::vector<Pose<Base, EndEffector>> poses_;
};

}  // namespace servocal::servo
