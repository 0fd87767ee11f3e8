// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::procedure {

/// How far one stream of one camera is.
struct EyeProgress {
  std::string camera;
  Stream stream = Stream::kColor;
  int views = 0;                    ///< Settled ones.
  bool found = false;               ///< It is known where it stands, roughly or well.
  std::optional<double> sigma_m;    ///< How well, by the accumulated estimate: length of the standard
  std::optional<double> sigma_rad;  ///< deviations of place and direction.
  std::optional<double> rms_px;     ///< Reprojection error of that estimate.
  CoverageSummary coverage;
  std::vector<TiltLimit> tilt_limits;
};

/// What the guard makes of the run's commands.
struct GuardLook {
  std::optional<Twist<Base>> wanted;   ///< The command in force, as it was asked for, and
  std::optional<Twist<Base>> applied;  ///< what the guard let through of it. Nothing if none is in force.
  std::string rule = "none";           ///< The strongest rule that intervened on it: "speed", "workspace", ...
  std::string reason;                  ///< A sentence; empty for "none".
  bool refused = false;                ///< It was turned down; the arm brakes or stands.
  std::map<std::string, int> interventions;  ///< Commands of this run by the strongest rule that intervened.
  std::optional<Instant> refused_at;         ///< Of the newest command that was refused,
  std::string refused_reason;                ///< and why; these two outlast it.
};

/// What the arm does and how much room its limits leave.
struct ArmLook {
  Instant stamp{};
  Twist<Base> twist;              ///< Measured.
  double joint_room_rad = 0.0;    ///< Of the joint nearest to its limit, to that limit.
  double workspace_room_m = 0.0;  ///< Of the flange to the nearest side of the workspace; negative outside.
  Duration max_frame_age{};       ///< Commands that rest on an older frame are refused.
  bool operator_stopped = false;
  GuardLook guard;
};

/// The newest frame of one eye, with what it shows.
struct Look {
  std::string camera;
  sensor::Frame frame;                   ///< Its pixels are shared with the run: read them only.
  std::vector<Eigen::Vector2d> corners;  ///< Detected, px; empty if the board was not found.
  std::vector<Eigen::Vector2d> goal;  ///< Outline of the pattern where the arm brings it, px; empty if this
                                      ///< eye has no goal now, or part of it is not in front of the camera.
  std::vector<Eigen::Vector2d> expected;  ///< The same where robot and accumulated estimate put it now.
  std::optional<double> error_px;         ///< RMS distance of the corners to their goal,
  std::optional<double> surprise_px;  ///< and to where they were expected: what the estimate is worth here.
  ArmLook arm;
};

/// Is called in the run's own thread, at most ten times a second of the run for each eye. It must be quick:
/// the loop waits for it.
using LookSink = std::function<void(const Look&)>;

}  // namespace servocal::procedure
