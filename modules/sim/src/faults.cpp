// SPDX-License-Identifier: GPL-3.0-or-later
#include "faults.h"

#include <algorithm>
#include <stdexcept>

namespace servocal::sim {

std::vector<SimulationFault> faultsInOrder(const SimulationConfig& simulation) {
  std::vector<SimulationFault> faults = simulation.faults;
  std::stable_sort(faults.begin(), faults.end(),
                   [](const SimulationFault& a, const SimulationFault& b) { return a.at_s < b.at_s; });
  return faults;
}

void checkFaults(const CellConfig& config) {
  for (const SimulationFault& fault : config.simulation->faults) {
    if (fault.kind == FaultKind::kInkjetPrint || fault.kind == FaultKind::kMountSlip) continue;
    const auto camera = std::find_if(config.cameras.begin(), config.cameras.end(),
                                     [&](const CameraConfig& other) { return other.name == fault.camera; });
    if (camera == config.cameras.end()) {
      throw std::invalid_argument(std::string("sim::Cell: the fault ") + toString(fault.kind) +
                                  " names the camera '" + fault.camera + "', which is not there");
    }
    const bool has_depth = camera->infrared && camera->infrared->depth;
    if (fault.kind == FaultKind::kDepthUnit && !has_depth) {
      throw std::invalid_argument("sim::Cell: camera '" + fault.camera +
                                  "' has no depth to be in another unit");
    }
  }
}

Eigen::Matrix3d rotation(const Eigen::Vector3d& rotation_rad) {
  const double angle = rotation_rad.norm();
  if (angle == 0.0) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, rotation_rad / angle).toRotationMatrix();
}

}  // namespace servocal::sim
