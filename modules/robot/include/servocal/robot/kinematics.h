// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"

namespace servocal::robot {

/// Forward and inverse kinematics of the serial chain between two links of a URDF, with any number of
/// revolute joints. Nominal: a real arm's own pose report is better where there is one. Const members
/// may be called from several threads at once.
///
/// Source: Orocos KDL (chain and Jacobian solvers; LMA inverse kinematics, Sugihara 2011).
class Kinematics {
 public:
  /// `arm.urdf` is "ur5" (built in) or the path of a URDF file.
  /// @throws Error (kInvalidConfig) if the URDF cannot be read, has no chain between the links, or has a
  ///   joint there that neither turns nor is fixed.
  explicit Kinematics(const ArmConfig& arm);
  ~Kinematics();
  Kinematics(Kinematics&&) noexcept;

  int joints() const;
  const Eigen::VectorXd& lower() const;  ///< Joint limits of the URDF, rad; infinite if continuous.
  const Eigen::VectorXd& upper() const;

  /// @throws std::invalid_argument unless q has joints() entries; the same below.
  Pose<Base, EndEffector> forward(const Eigen::VectorXd& q) const;
  /// 6 x joints; takes joint speeds (rad/s) to the Twist<Base> of the end effector, linear first.
  Eigen::MatrixXd jacobian(const Eigen::VectorXd& q) const;
  /// Joint angles inside the limits (by `margin_rad`) that reach the pose to 0.1 mm and 0.1 mrad: of the
  /// solutions found, the nearest to `seed`, each angle on the turn nearest to it. Deterministic
  /// restarts if the first search ends elsewhere. Nothing if none was found.
  std::optional<Eigen::VectorXd> inverse(const Pose<Base, EndEffector>& bMe,
                                         const Eigen::VectorXd& seed, double margin_rad = 0.0) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::robot
