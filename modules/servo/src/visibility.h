// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

#include "servocal/core/camera_model.h"
#include "servocal/core/pose.h"
#include "view_tracker.h"

namespace servocal::servo {

/// How the target points move in the image.
struct PixelMotion {
  std::vector<Eigen::Vector2d> pixels;  ///< Where the points are, px.
  Eigen::MatrixXd rates;  ///< 2n x 6: pixel velocities (px/s; u v u v ...) by the twist of e in e.
};

/// Nothing if a point does not project.
std::optional<PixelMotion> pixelMotion(const CameraModel& camera, const View& view,
                                       const std::vector<Eigen::Vector3d>& points_o);

/// The twist nearest to `wanted` with which no point heads for the image border faster than `rate_per_s`
/// times its distance from the margin; a point that is beyond the margin may only come back. So points
/// slide along the margin instead of crossing it, and standing still is always allowed.
///
/// min |x - r|^2 s.t. C x <= d, d >= 0, by Hildreth's dual coordinate ascent, then scaled into the
/// feasible set should the ascent end early. Distance counts 1 rad as much as 0.2 m.
///
/// Source: Hildreth, "A quadratic programming procedure", Naval Research Logistics Quarterly 4, 1957;
/// the velocity damper: Faverjon & Tournassoud, ICRA 1987.
Twist<EndEffector> keepInView(const Twist<EndEffector>& wanted, const PixelMotion& motion,
                              const CameraModel& camera, double margin_px, double rate_per_s);

}  // namespace servocal::servo
