// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/robot/guard.h"
#include "servocal/servo/drive.h"

namespace servocal::servo {

struct FollowOptions {
  double speed_share = 1.0;                     ///< Of the guard's speed limits; (0, 1].
  std::optional<double> max_joint_speed_radps;  ///< Besides; for a sweep that slow cameras watch.
  /// Asked about every watch_every while the arm moves: a reason to stop here, or nothing. May sleep, e.g.
  /// wait for a frame, but must come back within the guard's command_timeout or the arm brakes meanwhile.
  std::function<std::optional<std::string>()> watch;
  Duration watch_every = std::chrono::milliseconds(100);
  double start_within_rad = 0.02;   ///< The arm must stand so near to the first point, per joint.
  double max_deviation_rad = 0.05;  ///< Farther from the path than this, per joint, is not following.
  Duration stuck_after = std::chrono::seconds(2);  ///< No progress for so long ends it.
};

/// Moves the arm along a path of joint angles, e.g. of robot::planPath(): from corner to corner in straight
/// lines of joint space, by joint speeds, so that redundant arms keep to it as well. Nearly straight corners
/// (10 degrees) are passed without slowing down; before others the arm brakes so early that the guard's look
/// ahead never leaves the path.
///
/// Ends with the arm at rest:
/// - kReached: within 1 mrad of the last point, per joint.
/// - kUnreachable, kLimit: before any motion, the guard objects to the last point, or to another one; or the
///   arm does not stand at the first. A path may lead out of what the guard objects to at the start.
/// - kLimit: the guard refused for 0.5 s, or the arm does not follow.
/// - kStopped: the operator (Guard::operatorStopped()) or FollowOptions::watch asked to stop; its reason.
///
/// @param path at least one point; rad, one angle per joint.
/// @throws std::invalid_argument for an empty path, points that are not finite joint angles, or options out
///   of range.
/// @throws Error (kHardwareAbsent, kSafetyStop) from the arm, which is told to stop.
[[nodiscard]] DriveOutcome followPath(robot::Guard& guard, Clock& clock,
                                      const std::vector<Eigen::VectorXd>& path,
                                      const FollowOptions& options = {});

}  // namespace servocal::servo
