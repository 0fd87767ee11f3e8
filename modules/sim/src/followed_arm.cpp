// SPDX-License-Identifier: GPL-3.0-or-later
#include "followed_arm.h"

namespace servocal::sim {

FollowedArm::FollowedArm(ArmMotion& motion, const CellConfig& config, std::uint64_t seed)
    : motion_(motion), nominal_(makeArmChain(config.arm)), real_(realArm(*nominal_, config, seed)),
      repeatability_(drawRepeatability(*config.simulation, seed)) {}

Eigen::Isometry3d FollowedArm::flangeAt(Instant instant) {
  const ArmMoment moment = motion_.at(instant);
  const Joints q(moment.q);
  const Eigen::Isometry3d error = nominal_->forward(q).inverse() * real_->forward(q);
  return repeatability_.apply(moment.bMe.isometry() * error, moment.travelled_rad);
}

std::vector<Eigen::Isometry3d> FollowedArm::nominalFrames(Instant instant) {
  return nominal_->frames(Joints(motion_.at(instant).q));
}

}  // namespace servocal::sim
