// SPDX-License-Identifier: GPL-3.0-or-later
// What one seed makes wrong with an arm.
#pragma once

#include <cstdint>
#include <memory>

#include "arm_chain.h"
#include "repeatability.h"
#include "servocal/core/cell_config.h"

namespace servocal::sim {

/// The nominal arm with this cell's accuracy.
/// @throws std::invalid_argument if the workspace box is out of reach.
std::unique_ptr<const ArmChain> realArm(const ArmChain& nominal, const CellConfig& config,
                                        std::uint64_t seed);
Repeatability drawRepeatability(const SimulationConfig& simulation, std::uint64_t seed);

}  // namespace servocal::sim
