// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <vector>

#include "arm_chain.h"

namespace servocal::sim {

/// The chain between two links of a URDF file: each joint sits at its origin in the frame before it and turns
/// about its axis there.
class UrdfArm final : public ArmChain {
 public:
  /// @throws Error (kInvalidConfig) if the file cannot be read, has no chain between the links, a joint there
  ///   neither turns nor is fixed, or there are more than kMostJoints.
  explicit UrdfArm(const ArmConfig& arm);

  std::string name() const override { return name_; }
  const Joints& lower() const override { return lower_; }
  const Joints& upper() const override { return upper_; }
  Eigen::Isometry3d forward(const Joints& q) const override { return frames(q).back(); }
  ArmJacobian jacobian(const Joints& q) const override;
  std::vector<Eigen::Isometry3d> frames(const Joints& q) const override;
  /// Every joint's origin, and the flange's, is shifted and turned.
  std::unique_ptr<ArmChain> perturbed(Random& random, double rms_error_m,
                                      const std::vector<Joints>& configurations) const override;

 private:
  std::string name_;
  std::vector<Eigen::Isometry3d> origins_;  ///< Of each joint in the frame before; last, of the flange.
  std::vector<Eigen::Vector3d> axes_;       ///< Of each joint, in its own frame.
  Joints lower_;
  Joints upper_;
};

}  // namespace servocal::sim
