// SPDX-License-Identifier: GPL-3.0-or-later
// The simulator's own kinematics. It shares no code with robot::Kinematics on purpose: a mistake there must
// show as a calibration error, not cancel out.
#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <string>
#include <vector>

#include "random.h"
#include "servocal/core/cell_config.h"

namespace servocal::sim {

constexpr int kMostJoints = 12;
using Joints = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostJoints, 1>;
using ArmJacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kMostJoints>;

/// A serial arm of revolute joints.
class ArmChain {
 public:
  virtual ~ArmChain() = default;

  virtual std::string name() const = 0;
  virtual const Joints& lower() const = 0;  ///< rad; infinite if the joint turns freely.
  virtual const Joints& upper() const = 0;
  int joints() const { return static_cast<int>(lower().size()); }

  /// bMe
  virtual Eigen::Isometry3d forward(const Joints& q) const = 0;
  /// Takes joint speeds to the flange's velocity along the base's axes, linear part first.
  virtual ArmJacobian jacobian(const Joints& q) const = 0;
  /// Base, the frame after each joint, and the flange.
  virtual std::vector<Eigen::Isometry3d> frames(const Joints& q) const = 0;
  /// A real arm of this type: its geometry off by random amounts, scaled so that the flange is off by
  /// `rms_error_m` (root mean square of the distance to the nominal flange) over `configurations`.
  virtual std::unique_ptr<ArmChain> perturbed(Random& random, double rms_error_m,
                                              const std::vector<Joints>& configurations) const = 0;
};

/// The built-in UR5, or the chain of a URDF file.
/// @throws Error (kInvalidConfig) if the file has no such chain.
std::unique_ptr<ArmChain> makeArmChain(const ArmConfig& arm);

}  // namespace servocal::sim
