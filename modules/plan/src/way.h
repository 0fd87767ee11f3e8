// SPDX-License-Identifier: GPL-3.0-or-later
// Can the arm get there, and how long does it take? What all planners ask.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"
#include "servocal/robot/guard.h"

namespace servocal::plan {

constexpr double kStopTimeS = 1.5;  // settling and grabbing, beside the travel

/// What is asked of a board thousands of times.
struct BoardPoints {
  explicit BoardPoints(const BoardSpec& board) : outline(board.patternOutline()), corners(board.corners()) {}
  std::vector<Eigen::Vector3d> outline, corners;
};

/// The corners' pixels if all squares are inside the image by the margin.
std::optional<std::vector<Eigen::Vector2d>> visibleCorners(const Pose<Color, Board>& cMo,
                                                           const CameraModel& camera,
                                                           const BoardPoints& board, double margin_px);

/// Of a straight motion at the speed limits.
double travelTimeS(const Pose<Base, EndEffector>& from, const Pose<Base, EndEffector>& to,
                   const MotionLimits& limits);

/// True if the flange can go straight from `from_q` to the pose: every step allowed, joints continuous.
bool straightWayFree(const robot::Guard& guard, const Eigen::VectorXd& from_q,
                     const Pose<Base, EndEffector>& bMe_goal, double min_singular_value);

/// True if one of the goals driven to before is about the same view.
bool isTried(const std::vector<Pose<Color, Board>>& tried, const Pose<Color, Board>& cdMo);

}  // namespace servocal::plan
