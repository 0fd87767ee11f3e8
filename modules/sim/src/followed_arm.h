// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>

#include "arm_errors.h"
#include "moving_arm.h"
#include "servocal/sim/arm_motion.h"

namespace servocal::sim {

/// An arm that another simulation moves, with this cell's errors: the flange is off what the controller
/// believes by as much as the real arm's is off the nominal one's, and by its repeatability.
class FollowedArm final : public MovingArm {
 public:
  FollowedArm(ArmMotion& motion, const CellConfig& config, std::uint64_t seed);

  Eigen::Isometry3d flangeAt(Instant instant) override;
  std::vector<Eigen::Isometry3d> nominalFrames(Instant instant) override;

 private:
  ArmMotion& motion_;
  std::unique_ptr<const ArmChain> nominal_;
  std::unique_ptr<const ArmChain> real_;
  Repeatability repeatability_;
};

}  // namespace servocal::sim
