// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"
#include "servocal/sim/cell.h"

namespace servocal::app {

struct CameraOptions {
  bool lock_exposure = false;  ///< Exposure and white balance stay as they are after two seconds.
  /// Not empty: what the cell's only camera delivers goes there (openni2::OpenOptions::record).
  std::filesystem::path record;
};

/// The cameras of a cell, each through the driver that the cell file names (CameraConfig::backend).
class Cameras {
 public:
  /// Opens them all. `simulation`: the cell that the images come from, nothing for real cameras; there,
  /// CameraConfig::device does not count. `simulation` and `clock` must outlive the cameras.
  /// @throws Error kHardwareAbsent with a sentence if a camera is not there, kInvalidConfig if its driver
  /// cannot be
  ///   simulated, or can only be.
  Cameras(const CellConfig& cell, Clock& clock, sim::Cell* simulation, const CameraOptions& options = {});
  ~Cameras();
  Cameras(const Cameras&) = delete;
  Cameras& operator=(const Cameras&) = delete;

  /// In the order of CellConfig::cameras.
  const std::vector<sensor::RgbdCamera*>& all() const;
  /// One line each, for the operator: what a device cannot do, and what nobody has proven yet.
  const std::vector<std::string>& notes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::app
