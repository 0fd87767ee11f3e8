// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>

namespace servocal::robot {

/// A box grown by a radius on all sides; a capsule if two of its sides are zero, a sphere if all are.
struct RoundedBox {
  Eigen::Vector3d half_m = Eigen::Vector3d::Zero();  ///< Half of its sides, along its own axes.
  double radius_m = 0.0;

  bool isBox() const { return half_m.x() > 0.0 || half_m.y() > 0.0; }  ///< Else a capsule along z.
};

/// Distance of two bodies, m; if they overlap, negative: how deep the one's core is in the other, which grows
/// as they move into each other. Exact where it is positive and below 0.1 m; a lower bound beyond.
///
/// Closed form for two capsules. The signed distance from a box is a convex function, so its least value on
/// a capsule's axis is found by a search. Two boxes touch or do not: positive values are FCL's.
double gap(const RoundedBox& a, const Eigen::Isometry3d& a_pose, const RoundedBox& b,
           const Eigen::Isometry3d& b_pose);

}  // namespace servocal::robot
