// SPDX-License-Identifier: GPL-3.0-or-later
#include "twist_limits.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace servocal::robot {

double speedUse(const Twist<Base>& twist, const Eigen::Matrix3d& bRe, const Body& body,
                const MotionLimits& limits) {
  const double turning = twist.angular_radps.norm();
  double fastest = twist.linear_mps.norm() + turning * body.radius_m;
  for (const Eigen::Vector3d& point_e : body.outline_e) {
    const Eigen::Vector3d lever = bRe * point_e;
    fastest = std::max(fastest, (twist.linear_mps + twist.angular_radps.cross(lever)).norm());
  }
  return std::max(fastest / limits.max_speed_mps, turning / limits.max_angular_speed_radps);
}

double brakingTime(const Twist<Base>& twist, const MotionLimits& limits) {
  return std::max(twist.linear_mps.norm() / limits.max_acceleration_mps2,
                  twist.angular_radps.norm() / limits.max_angular_acceleration_radps2);
}

Eigen::VectorXd jointSpeeds(const Eigen::MatrixXd& jacobian, const Twist<Base>& twist) {
  const Eigen::Matrix<double, 6, 1> wanted = stacked(twist);
  if (wanted.isZero(0.0)) return Eigen::VectorXd::Zero(jacobian.cols());
  const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> solver(jacobian);
  Eigen::VectorXd speeds = solver.solve(wanted);
  if ((jacobian * speeds - wanted).norm() > 1e-6 * wanted.norm())
    speeds.setConstant(std::numeric_limits<double>::infinity());
  return speeds;
}

// Rooted from the square: exact enough where it matters, and an order faster than a decomposition.
double smallestSingularValue(const Eigen::MatrixXd& jacobian) {
  const Eigen::Matrix<double, 6, 6> square = jacobian * jacobian.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(square, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()[0]));
}

}  // namespace servocal::robot
