// SPDX-License-Identifier: GPL-3.0-or-later
// The simulator's own kinematics of a UR5. It shares no code with robot::Kinematics on purpose: a
// mistake there must show as a calibration error, not cancel out.
#pragma once

#include <Eigen/Geometry>
#include <array>

#include "random.h"

namespace servocal::sim {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// One joint after Denavit and Hartenberg: Rz(q + offset) Tz(d) Tx(a) Rx(alpha).
struct DhJoint {
  double a_m = 0.0;
  double alpha_rad = 0.0;
  double d_m = 0.0;
  double offset_rad = 0.0;
};

class Ur5 {
 public:
  /// The manufacturer's parameters, base frame "base" and flange "tool0" as the controller has them.
  /// Source: Universal Robots, "DH Parameters for calculations of kinematics and dynamics".
  Ur5();

  /// A real arm of this type: every parameter off by a random amount, scaled so that the flange is off
  /// by `rms_error_m` (root mean square of the distance to the nominal flange) over `configurations`.
  template <class Configurations>
  static Ur5 perturbed(Random& random, double rms_error_m, const Configurations& configurations);

  /// bMe
  Eigen::Isometry3d forward(const Vector6d& q) const;
  /// Takes joint speeds to the flange's velocity along the base's axes, linear part first.
  Matrix6d jacobian(const Vector6d& q) const;
  /// Base, the frame after each joint; the last is the flange.
  std::array<Eigen::Isometry3d, 7> frames(const Vector6d& q) const;

  static constexpr double kJointLimitRad = 2.0 * M_PI;

 private:
  std::array<DhJoint, 6> joints_;
};

template <class Configurations>
Ur5 Ur5::perturbed(Random& random, double rms_error_m, const Configurations& configurations) {
  const Ur5 nominal;
  std::array<DhJoint, 6> unit;
  for (DhJoint& joint : unit) {
    // Lengths and angles weigh alike at about half a metre from the axis.
    joint = {1e-4 * random.normal(), 2e-4 * random.normal(), 1e-4 * random.normal(),
             2e-4 * random.normal()};
  }
  double scale = 1.0;
  Ur5 arm;
  for (int iteration = 0; iteration < 4; ++iteration) {  // The error is almost linear in the scale.
    for (int i = 0; i < 6; ++i) {
      arm.joints_[i].a_m = nominal.joints_[i].a_m + scale * unit[i].a_m;
      arm.joints_[i].alpha_rad = nominal.joints_[i].alpha_rad + scale * unit[i].alpha_rad;
      arm.joints_[i].d_m = nominal.joints_[i].d_m + scale * unit[i].d_m;
      arm.joints_[i].offset_rad = nominal.joints_[i].offset_rad + scale * unit[i].offset_rad;
    }
    double sum = 0.0;
    for (const auto& q : configurations) {
      sum += (arm.forward(q).translation() - nominal.forward(q).translation()).squaredNorm();
    }
    const double rms = std::sqrt(sum / static_cast<double>(configurations.size()));
    if (iteration < 3) scale *= rms_error_m / rms;
  }
  return arm;
}

}  // namespace servocal::sim
