// SPDX-License-Identifier: GPL-3.0-or-later
#include "scene.h"

#include <algorithm>
#include <stdexcept>

#include "faults.h"

namespace servocal::sim {
namespace {

// Somebody screwed the board on by eye.
Eigen::Isometry3d drawMount(const Eigen::Isometry3d& nominal, const SimulationConfig& simulation,
                            std::uint64_t seed) {
  Random random(seed, "mount");
  const Eigen::Vector3d axis = random.direction();
  const double angle = random.uniform(0.0, simulation.mount_rotation_spread_rad);
  const Eigen::Vector3d shift =
      random.direction() * random.uniform(0.0, simulation.mount_translation_spread_m);
  Eigen::Isometry3d mount = nominal;
  mount.linear() = Eigen::AngleAxisd(angle, axis) * mount.linear();
  mount.translation() += shift;
  return mount;
}

bool onFlange(const CameraConfig& camera) { return camera.mount == Mount::kFlange; }

bool decideBoardOnFlange(const CellConfig& config) {
  if (!config.simulation) throw std::invalid_argument("sim::Cell: the cell has no simulation section");
  const auto flange = std::count_if(config.cameras.begin(), config.cameras.end(), onFlange);
  if (flange == 0) return true;
  if (flange != static_cast<std::ptrdiff_t>(config.cameras.size())) {
    throw std::invalid_argument(
        "sim::Cell: there is one board: the cameras are all fixed, with the board on the flange, or all on "
        "the "
        "flange");
  }
  if (!config.simulation->nominal_bMo) {
    throw std::invalid_argument(
        "sim::Cell: with the cameras on the flange the simulation needs nominal_bMo: where the board stands");
  }
  return false;
}

Eigen::Isometry3d nominalMount(const CellConfig& config) {
  return decideBoardOnFlange(config) ? config.simulation->nominal_eMo.isometry()
                                     : config.simulation->nominal_bMo->isometry();
}

}  // namespace

Scene::Scene(MovingArm& arm, const CellConfig& config, std::uint64_t seed)
    : config_(config), arm_(arm), board_on_flange_(decideBoardOnFlange(config)),
      mount_(drawMount(nominalMount(config), *config.simulation, seed)) {
  for (const SimulationFault& fault : faultsInOrder(simulation())) {
    if (fault.kind != FaultKind::kMountSlip) continue;
    Eigen::Isometry3d slipped = mount_.last();
    slipped.linear() = rotation(fault.rotation_rad) * slipped.linear();
    slipped.translation() += fault.translation_m;
    mount_.step(Instant(fromSeconds(fault.at_s)), slipped);
  }
}

Eigen::Isometry3d Scene::cMo(const SteppedPose& camera, Instant instant) const {
  if (board_on_flange_) return camera.at(instant).inverse() * arm_.flangeAt(instant) * mount_.at(instant);
  const Eigen::Isometry3d bMc = arm_.flangeAt(instant) * camera.at(instant);
  return bMc.inverse() * mount_.at(instant);
}

std::vector<Capsule> Scene::armLinks(const SteppedPose& camera, Instant instant) const {
  if (!board_on_flange_) return {};  // Behind the camera.
  const Eigen::Isometry3d cMb = camera.at(instant).inverse();
  const auto frames = arm_.nominalFrames(instant);
  // Thickness and gray of the links of a UR5, from the base on; more joints take the last.
  constexpr double kRadiusM[] = {0.075, 0.060, 0.050, 0.040, 0.040, 0.040};
  constexpr double kGray[] = {60.0, 150.0, 140.0, 60.0, 70.0, 50.0};
  std::vector<Capsule> links;
  for (std::size_t i = 0; i + 1 < frames.size(); ++i) {
    const std::size_t kind = std::min<std::size_t>(i, 5);
    links.push_back(
        {cMb * frames[i].translation(), cMb * frames[i + 1].translation(), kRadiusM[kind], kGray[kind]});
  }
  links.push_back({cMb * frames.back().translation(),
                   cMb * (frames.back() * mount_.at(instant).translation()), 0.02, 45.0});
  return links;
}

}  // namespace servocal::sim
