// SPDX-License-Identifier: GPL-3.0-or-later
// Small steps of rigid transforms, as the solvers take them.
#pragma once

#include <Eigen/Geometry>
#include <cmath>

namespace servocal::calib {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Matrix36d = Eigen::Matrix<double, 3, 6>;

/// skew(a) b = a x b.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d matrix;
  matrix << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return matrix;
}

/// Rotation matrix of a rotation vector (rad).
inline Eigen::Matrix3d rotationExp(const Eigen::Vector3d& rotation_rad) {
  const double angle = rotation_rad.norm();
  if (!(angle > 0.0)) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, rotation_rad / angle).toRotationMatrix();
}

/// Right Jacobian of the rotation group: exp(w + dw) = exp(w) exp(J_r(w) dw) to first order.
/// Source: Chirikjian, "Stochastic Models, Information Theory, and Lie Groups" vol. 2, eq. 10.86.
inline Eigen::Matrix3d rightJacobian(const Eigen::Vector3d& rotation_rad) {
  const double angle2 = rotation_rad.squaredNorm();
  const Eigen::Matrix3d w = skew(rotation_rad);
  if (angle2 < 1e-8) return Eigen::Matrix3d::Identity() - 0.5 * w + w * w / 6.0;
  const double angle = std::sqrt(angle2);
  return Eigen::Matrix3d::Identity() - (1.0 - std::cos(angle)) / angle2 * w +
         (angle - std::sin(angle)) / (angle2 * angle) * w * w;
}

/// The pose after a small motion applied on the left: translation (m) first, rotation vector (rad) last,
/// both along the axes of the left frame.
inline Eigen::Isometry3d moved(const Eigen::Isometry3d& pose, const Vector6d& step) {
  const Eigen::Matrix3d rotation = rotationExp(step.tail<3>());
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.linear() = rotation * pose.linear();
  out.translation() = rotation * pose.translation() + step.head<3>();
  return out;
}

/// Derivative of a point (in the left frame) by such a motion.
inline Matrix36d pointByMotion(const Eigen::Vector3d& point) {
  Matrix36d jacobian;
  jacobian << Eigen::Matrix3d::Identity(), -skew(point);
  return jacobian;
}

}  // namespace servocal::calib
