// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sim/cell.h"

#include <algorithm>
#include <stdexcept>

#include "cell_impl.h"

namespace servocal::sim {
namespace {

// Somebody screwed the board on by eye.
Eigen::Isometry3d drawMount(const SimulationConfig& simulation, std::uint64_t seed) {
  Random random(seed, "mount");
  const Eigen::Vector3d axis = random.direction();
  const double angle = random.uniform(0.0, simulation.mount_rotation_spread_rad);
  const Eigen::Vector3d shift =
      random.direction() * random.uniform(0.0, simulation.mount_translation_spread_m);
  Eigen::Isometry3d eMo = simulation.nominal_eMo.isometry();
  eMo.linear() = Eigen::AngleAxisd(angle, axis) * eMo.linear();
  eMo.translation() += shift;
  return eMo;
}

const SimulatedCameraConfig& counterpart(const SimulationConfig& simulation, const CameraConfig& camera) {
  const auto found =
      std::find_if(simulation.cameras.begin(), simulation.cameras.end(),
                   [&](const SimulatedCameraConfig& candidate) { return candidate.name == camera.name; });
  if (found == simulation.cameras.end()) {
    throw std::invalid_argument("sim::Cell: camera '" + camera.name + "' has no entry under simulation");
  }
  const bool sound = camera.width_px >= 64 && camera.width_px <= SensorNoise::kMaxWidthPx &&
                     camera.height_px >= 64 && found->rate_hz > 0.0 && found->exposure_s >= 0.0 &&
                     found->latency_s >= 0.0 && found->focal_px > 0.0 && found->focus_distance_m > 0.0;
  if (!sound) {
    throw std::invalid_argument("sim::Cell: camera '" + camera.name +
                                "' needs a size of 64 to 4096 px, a rate, a focal length and a focus "
                                "distance above zero, and no negative exposure or latency");
  }
  return *found;
}

}  // namespace

Cell::Impl::Impl(const CellConfig& cell_config, std::uint64_t cell_seed)
    : config(cell_config), seed(cell_seed) {
  if (!config.simulation) throw std::invalid_argument("sim::Cell: the cell has no simulation section");
  eMo = drawMount(*config.simulation, seed);
  arm = std::make_unique<SimulatedArm>(clock, config, seed);
  for (const CameraConfig& camera : config.cameras) {
    if (camera.mount != Mount::kFixed) {
      throw std::invalid_argument("sim::Cell: camera '" + camera.name + "' is not fixed in the cell");
    }
    const SimulatedCameraConfig& simulated = counterpart(*config.simulation, camera);
    cameras[camera.name] = std::make_unique<SimulatedCamera>(clock, *arm, config.board, eMo, camera,
                                                             simulated, *config.simulation, seed);
  }
}

Cell::Cell(const CellConfig& config, std::uint64_t seed) : impl_(std::make_unique<Impl>(config, seed)) {}
Cell::~Cell() = default;
Cell::Cell(Cell&&) noexcept = default;

Clock& Cell::clock() { return impl_->clock; }
robot::Arm& Cell::arm() { return *impl_->arm; }

sensor::RgbdCamera& Cell::camera(const std::string& name) {
  const auto found = impl_->cameras.find(name);
  if (found == impl_->cameras.end()) {
    throw std::invalid_argument("sim::Cell: there is no camera '" + name + "'");
  }
  return *found->second;
}

}  // namespace servocal::sim
