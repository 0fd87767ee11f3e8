// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "servocal/core/cell_config.h"

namespace servocal::sim {

/// By time.
std::vector<SimulationFault> faultsInOrder(const SimulationConfig& simulation);
/// @throws std::invalid_argument if a fault names a camera that is not there, or one without depth.
void checkFaults(const CellConfig& config);
/// Of a rotation vector.
Eigen::Matrix3d rotation(const Eigen::Vector3d& rotation_rad);

}  // namespace servocal::sim
