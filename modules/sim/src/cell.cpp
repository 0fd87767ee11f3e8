// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sim/cell.h"

#include <algorithm>
#include <stdexcept>

#include "cell_impl.h"
#include "faults.h"

namespace servocal::sim {
namespace {

bool isSound(const SimulatedSensorConfig& sensor, int width_px, int height_px) {
  return width_px >= 64 && width_px <= SensorNoise::kMaxWidthPx && height_px >= 64 && sensor.rate_hz > 0.0 &&
         sensor.exposure_s >= 0.0 && sensor.latency_s >= 0.0 && sensor.focal_px > 0.0 &&
         sensor.focus_distance_m > 0.0;
}

const SimulatedCameraConfig& counterpart(const SimulationConfig& simulation, const CameraConfig& camera) {
  const auto found =
      std::find_if(simulation.cameras.begin(), simulation.cameras.end(),
                   [&](const SimulatedCameraConfig& candidate) { return candidate.name == camera.name; });
  if (found == simulation.cameras.end()) {
    throw std::invalid_argument("sim::Cell: camera '" + camera.name + "' has no entry under simulation");
  }
  bool sound = isSound(*found, camera.width_px, camera.height_px);
  if (camera.infrared) {
    const auto infrared = found->infrared.value_or(SimulatedInfraredConfig::like(*camera.infrared));
    sound &= isSound(infrared, camera.infrared->width_px, camera.infrared->height_px);
  }
  if (!sound) {
    throw std::invalid_argument("sim::Cell: camera '" + camera.name +
                                "' needs a size of 64 to 4096 px, a rate, a focal length and a focus "
                                "distance above zero, and no negative exposure or latency");
  }
  return *found;
}

}  // namespace

Cell::Impl::Impl(const CellConfig& cell_config, std::uint64_t cell_seed)
    : Impl(cell_config, cell_seed, nullptr, nullptr) {}

Cell::Impl::Impl(const CellConfig& cell_config, std::uint64_t cell_seed, Clock& run_clock, ArmMotion& motion)
    : Impl(cell_config, cell_seed, &run_clock, &motion) {}

Cell::Impl::Impl(const CellConfig& cell_config, std::uint64_t cell_seed, Clock* run_clock, ArmMotion* motion)
    : config(cell_config), seed(cell_seed), clock(run_clock ? *run_clock : own_clock) {
  if (!config.simulation) throw std::invalid_argument("sim::Cell: the cell has no simulation section");
  checkFaults(config);
  if (motion) followed = std::make_unique<FollowedArm>(*motion, config, seed);
  else arm = std::make_unique<SimulatedArm>(own_clock, config, seed);
  MovingArm& seen = followed ? static_cast<MovingArm&>(*followed) : *arm;
  scene = std::make_unique<Scene>(seen, config, seed);
  for (const CameraConfig& camera : config.cameras) {
    cameras[camera.name] = std::make_unique<SimulatedCamera>(clock, *scene, camera,
                                                             counterpart(*config.simulation, camera), seed);
  }
}

Cell::Cell(const CellConfig& config, std::uint64_t seed) : impl_(std::make_unique<Impl>(config, seed)) {}
Cell::Cell(const CellConfig& config, std::uint64_t seed, Clock& clock, ArmMotion& motion)
    : impl_(std::make_unique<Impl>(config, seed, clock, motion)) {}
Cell::~Cell() = default;
Cell::Cell(Cell&&) noexcept = default;

Clock& Cell::clock() { return impl_->clock; }
robot::Arm& Cell::arm() {
  if (!impl_->arm) throw std::invalid_argument("sim::Cell: this cell's arm is simulated elsewhere");
  return *impl_->arm;
}

sensor::RgbdCamera& Cell::camera(const std::string& name) {
  const auto found = impl_->cameras.find(name);
  if (found == impl_->cameras.end()) {
    throw std::invalid_argument("sim::Cell: there is no camera '" + name + "'");
  }
  return *found->second;
}

}  // namespace servocal::sim
