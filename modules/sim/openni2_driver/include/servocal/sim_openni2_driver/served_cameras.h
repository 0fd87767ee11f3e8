// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::sim_openni2_driver {

/// The URI under which a camera of this name is served.
inline std::string uriOf(const std::string& camera) { return "servocal://" + camera; }

/// A camera as an OpenNI2 device: URI "servocal://<name>", the camera's own serial number and modes.
struct Served {
  sensor::RgbdCamera* camera = nullptr;  ///< Must outlive ServedCameras.
  bool tenth_millimetres = false;        ///< Offers depth in 100 um only, as some devices do.
  bool frame_sync = false;               ///< Says that it exposes depth and color together.
  bool has_serial = true;                ///< Some drivers cannot tell a serial number.
};

/// Serves cameras, usually those of a sim::Cell, as OpenNI2 devices of this process, until destruction.
///
/// The driver that libOpenNI2 loads has no thread and no clock: when somebody waits for a frame, libOpenNI2
/// asks the driver for one (its "manual trigger"), and the driver takes what the camera has delivered by
/// `clock`'s now. So in a simulated cell nothing waits for wall time, only frames that somebody may read are
/// rendered, and a run is as deterministic as without OpenNI2. For one thread, as sim::Cell.
///
/// Frames as on the wire of a Kinect: color RGB888 (gray cameras: three equal channels), infrared GRAY16 of
/// ten bits (four times the eight bits of a simulated camera), depth in mm or 100 um. Streams that exclude
/// each other refuse to start together.
class ServedCameras {
 public:
  /// @throws Error (kHardwareAbsent) if the libOpenNI2 of this process does not read the folder that holds
  /// our
  ///   driver: says with which LD_LIBRARY_PATH to start.
  ServedCameras(const Clock& clock, const std::vector<Served>& cameras);
  ~ServedCameras();
  ServedCameras(const ServedCameras&) = delete;
  ServedCameras& operator=(const ServedCameras&) = delete;

  /// As if the cable was pulled, and put in again.
  void unplug(const std::string& name);
  void plug(const std::string& name);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::sim_openni2_driver
