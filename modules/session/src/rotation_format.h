// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace servocal::session {

/// Every named order of Euler angles: "extrinsic_xyz" (rotations about fixed axes, x first, so
/// R = Rz Ry Rx), "intrinsic_zyx" (about moving axes, z first; the same R = Rz Ry Rx), ...
const std::vector<std::string>& eulerOrders();

/// Names of the three angles of an order: rx, ry, rz (by axis, whatever the order) if the axes differ; a1,
/// a2, a3 (in the order's sequence) if one axis comes twice, as in "intrinsic_zyz".
std::vector<std::string> eulerAngleNames(const std::string& order);

/// Rotation of the angles (rad) in the sequence of eulerAngleNames(order).
Eigen::Matrix3d fromEuler(const std::string& order, const Eigen::Vector3d& angles_rad);

/// How far a matrix is from a rotation: largest entry of |R^T R - 1|; 2 if it mirrors.
double distanceFromRotation(const Eigen::Matrix3d& matrix);

/// The rotation nearest to a matrix (polar decomposition), to take out the rounding of printed numbers.
Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& matrix);

}  // namespace servocal::session
