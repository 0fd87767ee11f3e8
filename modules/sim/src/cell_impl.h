// SPDX-License-Identifier: GPL-3.0-or-later
// Inside of sim::Cell; the tests' truth reads it too.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "followed_arm.h"
#include "scene.h"
#include "servocal/sim/cell.h"
#include "simulated_arm.h"
#include "simulated_camera.h"

namespace servocal::sim {

struct Cell::Impl {
  CellConfig config;
  std::uint64_t seed;
  SimulatedClock own_clock;
  Clock& clock;
  std::unique_ptr<SimulatedArm> arm;      ///< Nothing if somebody else moves the arm:
  std::unique_ptr<FollowedArm> followed;  ///< then this one.
  std::unique_ptr<Scene> scene;
  std::map<std::string, std::unique_ptr<SimulatedCamera>> cameras;

  Impl(const CellConfig& config, std::uint64_t seed);
  Impl(const CellConfig& config, std::uint64_t seed, Clock& clock, ArmMotion& motion);

 private:
  Impl(const CellConfig& config, std::uint64_t seed, Clock* clock, ArmMotion* motion);
};

}  // namespace servocal::sim
