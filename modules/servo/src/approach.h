// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>

#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"
#include "servocal/robot/guard.h"

namespace servocal::servo {

/// Speed at which to be at this distance from a stop: braking at a constant rate that ends in an exponential.
double speedAt(double distance, double limit, double acceleration, double gain_per_s);

/// What to multiply a remaining distance (m, rad, kept in proportion) by to get the speed: the limits far
/// away, constant braking nearer, and an exponential end with `gain_per_s`. `share` scales the speed
/// limits.
double approachGain(double distance_m, double angle_rad, const MotionLimits& limits,
                    double gain_per_s, double share);

/// Twist on the straight way from one flange pose to another: position and rotation interpolated
/// together.
Twist<Base> approach(const Pose<Base, EndEffector>& from, const Pose<Base, EndEffector>& to,
                     const MotionLimits& limits, double gain_per_s, double share);

/// Why the arm cannot go straight from its joint angles to a flange pose: a sentence; nothing if it can.
/// `goal` tells an objection to the end from one to the way.
struct WayObjection {
  bool goal = false;
  std::string reason;
};
std::optional<WayObjection> rehearse(const robot::Guard& guard, const RobotState& from,
                                     const Pose<Base, EndEffector>& to);

}  // namespace servocal::servo
