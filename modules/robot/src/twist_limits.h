// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"

namespace servocal::robot {

inline Eigen::Matrix<double, 6, 1> stacked(const Twist<Base>& twist) {
  Eigen::Matrix<double, 6, 1> both;
  both << twist.linear_mps, twist.angular_radps;
  return both;
}

/// What moves with the flange: points in e (m), and a sphere around the flange's origin.
struct Body {
  std::vector<Eigen::Vector3d> outline_e;  ///< Corners; the fastest point of the body is among them.
  std::vector<Eigen::Vector3d> points_e;   ///< Outline and inside, dense enough for the boxes.
  double radius_m = 0.0;
};

/// How many times the speed limits the twist is: at most 1 if it obeys them. A measure that is convex in
/// the twist.
double speedUse(const Twist<Base>& twist, const Eigen::Matrix3d& bRe, const Body& body,
                const MotionLimits& limits);

/// Seconds of full braking that take the twist to rest while it keeps its direction.
double brakingTime(const Twist<Base>& twist, const MotionLimits& limits);

/// Joint speeds (least norm) that make this twist, rad/s. Infinite where the arm cannot make it, that is
/// at a singularity.
Eigen::VectorXd jointSpeeds(const Eigen::MatrixXd& jacobian, const Twist<Base>& twist);

/// Of the Jacobian (m and rad mixed).
double smallestSingularValue(const Eigen::MatrixXd& jacobian);

}  // namespace servocal::robot
