// SPDX-License-Identifier: GPL-3.0-or-later
#include "arm_errors.h"

#include <algorithm>
#include <stdexcept>
#include <vector>

namespace servocal::sim {
namespace {

// Configurations the arm of this cell may take: the flange is in the workspace box, if there is one.
std::vector<Joints> configurationsIn(const Box& workspace, const ArmChain& arm, Random& random) {
  const bool bounded = (workspace.max_m.array() > workspace.min_m.array()).all();
  std::vector<Joints> configurations;
  for (int tries = 0; configurations.size() < 300 && tries < 100000; ++tries) {
    Joints q(arm.joints());
    for (int i = 0; i < arm.joints(); ++i) {
      q[i] = random.uniform(std::max(-M_PI, arm.lower()[i]), std::min(M_PI, arm.upper()[i]));
    }
    if (bounded && !workspace.contains(arm.forward(q).translation())) continue;
    configurations.push_back(q);
  }
  if (configurations.empty()) {
    throw std::invalid_argument("sim::Cell: the workspace box is out of the arm's reach");
  }
  return configurations;
}

}  // namespace

std::unique_ptr<const ArmChain> realArm(const ArmChain& nominal, const CellConfig& config,
                                        std::uint64_t seed) {
  Random random(seed, "arm kinematics");
  const auto configurations = configurationsIn(config.limits.workspace, nominal, random);
  return nominal.perturbed(random, config.simulation->accuracy_m, configurations);
}

Repeatability drawRepeatability(const SimulationConfig& simulation, std::uint64_t seed) {
  Random random(seed, "arm repeatability");
  return Repeatability(random, simulation.repeatability_m, simulation.repeatability_rad);
}

}  // namespace servocal::sim
