// SPDX-License-Identifier: GPL-3.0-or-later
// The default cell, in code, for tests that must not depend on the reading of cell files.
#pragma once

#include "servocal/core/cell_config.h"

namespace servocal::test {

/// One UR5 with the board on its flange, one Kinect-v2-like color camera in front of it.
inline CellConfig defaultSimCell() {
  CellConfig config;
  config.name = "default";
  // Elbow up, wrist below the forearm; the board faces the camera from 0.6 m.
  config.arm.start_q.resize(6);
  config.arm.start_q << 164.5, -82.1, 113.6, 148.5, -74.5, 0.0;
  config.arm.start_q *= M_PI / 180.0;
  config.limits.workspace = {"workspace", {0.0, -0.75, 0.02}, {1.0, 0.75, 1.0}};
  config.limits.keep_out = {{"camera", {1.00, -0.15, 0.25}, {1.30, 0.15, 0.55}},
                            {"arm base", {-0.15, -0.15, 0.0}, {0.15, 0.15, 0.30}}};
  CameraConfig camera;
  camera.name = "front";
  config.cameras = {camera};

  SimulationConfig simulation;
  // The board's back is towards the flange: its z points against the flange's own.
  simulation.nominal_eMo = Pose<EndEffector, Board>::fromRotationVector({0.0, M_PI, 0.0}, {0.0, 0.0, 0.06});
  SimulatedCameraConfig simulated;
  simulated.name = camera.name;
  simulated.position_m = {1.15, 0.0, 0.40};
  simulated.look_at_m = {0.0, 0.0, 0.40};
  simulation.cameras = {simulated};
  config.simulation = simulation;
  return config;
}

/// The same with a whole Kinect: v2 (time of flight) or v1 (structured light, color or infrared at a time).
inline CellConfig kinectSimCell(DepthSensor sensor) {
  CellConfig config = defaultSimCell();
  CameraConfig& camera = config.cameras[0];
  camera.infrared = InfraredConfig{};
  camera.infrared->depth = sensor;
  if (sensor == DepthSensor::kStructuredLight) {
    camera.width_px = 640;
    camera.height_px = 480;
    camera.horizontal_fov_rad = 1.095;
    camera.infrared->width_px = 640;
    camera.infrared->height_px = 480;
    camera.infrared->horizontal_fov_rad = 1.008;
    camera.infrared->excludes_color = true;
    config.simulation->cameras[0].focal_px = 525.0;
  }
  return config;
}

}  // namespace servocal::test
