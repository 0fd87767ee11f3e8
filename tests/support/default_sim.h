// SPDX-License-Identifier: GPL-3.0-or-later
// The default cell, in code, for tests that must not depend on the reading of cell files.
#pragma once

#include "servocal/core/cell_config.h"

namespace servocal::test {

/// One UR5 with the board on its flange, one Kinect-v2-like color camera in front of it.
inline CellConfig defaultSimCell() {
  CellConfig config;
  config.name = "default";
  config.arm.start_q.resize(6);
  config.arm.start_q << 3.37, -1.80, 2.30, -0.50, 1.60, 0.0;
  config.limits.workspace = {"workspace", {-0.2, -0.75, 0.02}, {0.95, 0.75, 1.0}};
  config.limits.keep_out = {{"camera", {0.90, -0.15, 0.20}, {1.20, 0.15, 0.50}},
                            {"arm base", {-0.15, -0.15, 0.0}, {0.15, 0.15, 0.30}}};
  CameraConfig camera;
  camera.name = "front";
  config.cameras = {camera};

  SimulationConfig simulation;
  // The board's back on the flange: its z points into the flange, against the flange's own.
  simulation.nominal_eMo = Pose<EndEffector, Board>::fromRotationVector({M_PI, 0.0, 0.0}, {0.0, 0.0, 0.06});
  SimulatedCameraConfig simulated;
  simulated.name = camera.name;
  simulated.position_m = {1.05, 0.0, 0.35};
  simulated.look_at_m = {0.0, 0.0, 0.35};
  simulation.cameras = {simulated};
  config.simulation = simulation;
  return config;
}

}  // namespace servocal::test
