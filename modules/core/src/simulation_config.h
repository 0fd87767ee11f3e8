// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/config_reader.h"

namespace servocal {

/// The `simulation:` section; every simulated camera of the cell must be described there, once.
SimulationConfig readSimulation(const ConfigReader& section, const std::vector<CameraConfig>& cameras);

}  // namespace servocal
