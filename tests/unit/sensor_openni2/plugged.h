// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <vector>

#include "default_sim.h"
#include "servocal/sensor_openni2/camera.h"
#include "servocal/sim/cell.h"
#include "servocal/sim_openni2_driver/served_cameras.h"

namespace servocal::test {

inline constexpr std::uint64_t kSeed = 3;

inline CellConfig kinect(DepthSensor sensor) {
  CellConfig cell = kinectSimCell(sensor);
  cell.cameras[0].backend = CameraBackend::kOpenNi2;
  cell.cameras[0].latency_s = 0.055;  // Of the simulated camera, from the middle of its exposure.
  return cell;
}

/// A simulated cell whose cameras are plugged in as OpenNI2 devices.
struct Plugged {
  explicit Plugged(const CellConfig& config, sim_openni2_driver::Served how = {})
      : cell(config, kSeed), served(cell.clock(), everyCamera(config, how)) {}

  std::vector<sim_openni2_driver::Served> everyCamera(const CellConfig& config,
                                                      sim_openni2_driver::Served how) {
    std::vector<sim_openni2_driver::Served> all;
    for (const CameraConfig& camera : config.cameras) {
      how.camera = &cell.camera(camera.name);
      all.push_back(how);
    }
    return all;
  }

  sim::Cell cell;
  sim_openni2_driver::ServedCameras served;
};

inline openni2::OpenOptions raw() {
  openni2::OpenOptions options;
  options.raw_infrared = true;
  return options;
}

}  // namespace servocal::test
