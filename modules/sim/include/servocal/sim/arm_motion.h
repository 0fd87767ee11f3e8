// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>

#include "servocal/core/clock.h"
#include "servocal/core/pose.h"

namespace servocal::sim {

/// One moment of an arm that somebody else simulates.
struct ArmMoment {
  Eigen::VectorXd q;            ///< rad
  Pose<Base, EndEffector> bMe;  ///< Where its controller believes the flange to be.
  double travelled_rad = 0.0;   ///< Length of the joint path up to here: the same only while it stands.
};

/// How an arm moved that somebody else simulates, e.g. a simulated controller. For the cameras of a Cell.
class ArmMotion {
 public:
  virtual ~ArmMotion() = default;
  /// At an instant of the last two seconds, interpolated; the newest or oldest moment there is, outside.
  virtual ArmMoment at(Instant instant) = 0;
};

}  // namespace servocal::sim
