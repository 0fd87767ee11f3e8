// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"

namespace servocal::servo {

/// An image point as the control law sees it.
struct ImagePoint {
  Eigen::Vector2d s = Eigen::Vector2d::Zero();  ///< Normalized, undistorted: X/Z, Y/Z.
  double depth_m = 0.0;                         ///< Z.
};

/// The motion of the end effector that takes the current points to the desired ones, for a gain of one
/// per second: +-(L cVe)^+ (s - s*), + if it carries them, - if it carries the camera; linear part first; a distance (m, rad) as much as a speed.
///
/// L is the mean of the current and the desired interaction matrix: the current one alone stalls where
/// the tilt of a plane changes sign. A function without memory: each call hands ViSP a complete, fresh
/// set of matrices, because vpServo goes on with old ones in silence.
///
/// @param cMe where the end effector is in the camera now (cMo oMe; or eMc^-1).
/// @throws std::invalid_argument unless there are at least four points, as many current as desired.
Twist<EndEffector> pointServo(const std::vector<ImagePoint>& current,
                              const std::vector<ImagePoint>& desired,
                              const Pose<Color, EndEffector>& cMe, Mount mount);

}  // namespace servocal::servo
