// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <utility>
#include <vector>

#include "servocal/core/clock.h"

namespace servocal::sim {

/// A pose that stays as it is until a fault changes it.
class SteppedPose {
 public:
  explicit SteppedPose(const Eigen::Isometry3d& first) : first_(first) {}

  /// From `instant` on, another pose. Steps come in the order of time.
  void step(Instant instant, const Eigen::Isometry3d& pose) { steps_.emplace_back(instant, pose); }
  const Eigen::Isometry3d& last() const { return steps_.empty() ? first_ : steps_.back().second; }

  const Eigen::Isometry3d& at(Instant instant) const {
    const Eigen::Isometry3d* pose = &first_;
    for (const auto& [from, stepped] : steps_) {
      if (instant >= from) pose = &stepped;
    }
    return *pose;
  }

 private:
  Eigen::Isometry3d first_;
  std::vector<std::pair<Instant, Eigen::Isometry3d>> steps_;
};

}  // namespace servocal::sim
