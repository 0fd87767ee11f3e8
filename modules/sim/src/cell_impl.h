// SPDX-License-Identifier: GPL-3.0-or-later
// Inside of sim::Cell; the tests' truth reads it too.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "scene.h"
#include "servocal/sim/cell.h"
#include "simulated_arm.h"
#include "simulated_camera.h"

namespace servocal::sim {

struct Cell::Impl {
  CellConfig config;
  std::uint64_t seed;
  SimulatedClock clock;
  std::unique_ptr<SimulatedArm> arm;
  std::unique_ptr<Scene> scene;
  std::map<std::string, std::unique_ptr<SimulatedCamera>> cameras;

  Impl(const CellConfig& config, std::uint64_t seed);
};

}  // namespace servocal::sim
