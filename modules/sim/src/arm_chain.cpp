// SPDX-License-Identifier: GPL-3.0-or-later
#include "arm_chain.h"

#include "ur5.h"
#include "urdf_arm.h"

namespace servocal::sim {
namespace {

class Ur5Chain final : public ArmChain {
 public:
  explicit Ur5Chain(const Ur5& arm) : arm_(arm) {}

  std::string name() const override { return "UR5"; }
  const Joints& lower() const override { return lower_; }
  const Joints& upper() const override { return upper_; }
  Eigen::Isometry3d forward(const Joints& q) const override { return arm_.forward(q); }
  ArmJacobian jacobian(const Joints& q) const override { return arm_.jacobian(q); }

  std::vector<Eigen::Isometry3d> frames(const Joints& q) const override {
    const auto frames = arm_.frames(q);
    return {frames.begin(), frames.end()};
  }

  std::unique_ptr<ArmChain> perturbed(Random& random, double rms_error_m,
                                      const std::vector<Joints>& configurations) const override {
    return std::make_unique<Ur5Chain>(Ur5::perturbed(random, rms_error_m, configurations));
  }

 private:
  Ur5 arm_;
  Joints lower_ = Joints::Constant(6, -Ur5::kJointLimitRad);
  Joints upper_ = Joints::Constant(6, Ur5::kJointLimitRad);
};

}  // namespace

std::unique_ptr<ArmChain> makeArmChain(const ArmConfig& arm) {
  if (arm.urdf == "ur5") return std::make_unique<Ur5Chain>(Ur5());
  return std::make_unique<UrdfArm>(arm);
}

}  // namespace servocal::sim
