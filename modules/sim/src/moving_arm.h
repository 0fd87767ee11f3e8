// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "servocal/core/clock.h"

namespace servocal::sim {

/// What the cameras look at, whoever moves it.
class MovingArm {
 public:
  virtual ~MovingArm() = default;
  /// The true bMe at an instant of the last two seconds.
  virtual Eigen::Isometry3d flangeAt(Instant instant) = 0;
  /// Base, the frame after each joint, and the flange at that instant, by nominal kinematics.
  virtual std::vector<Eigen::Isometry3d> nominalFrames(Instant instant) = 0;
};

}  // namespace servocal::sim
