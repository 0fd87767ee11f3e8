// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "board_layer.h"
#include "depth_errors.h"
#include "lens.h"
#include "servocal/core/cell_config.h"
#include "stepped_pose.h"

namespace servocal::sim {

/// The infrared and depth side of one camera, as one seed has drawn it.
struct InfraredTruth {
  SimulatedInfraredConfig config;
  Lens lens;
  Eigen::Isometry3d cMi;
  Light light;
  double phase_s = 0.0;  ///< Of its exposures against the color camera's.
  std::optional<DepthErrors> depth;
};

/// One camera, as one seed has drawn it.
struct CameraTruth {
  Lens lens;
  SteppedPose pose;  ///< bMc, or eMc on the flange.
  Light light;
  std::optional<InfraredTruth> infrared;
};

/// @throws std::invalid_argument if the camera would look along the axis that its picture is upright to, or a
///   lens has not five coefficients.
CameraTruth drawCamera(const CameraConfig& camera, const SimulatedCameraConfig& simulated,
                       const SimulationConfig& simulation, std::uint64_t seed);

}  // namespace servocal::sim
