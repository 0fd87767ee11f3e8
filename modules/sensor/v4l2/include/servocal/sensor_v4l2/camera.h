// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::v4l2 {

struct OpenOptions {
  bool lock_exposure = false;  ///< Exposure and white balance keep the values they have after `settle`.
  Duration settle = std::chrono::seconds(2);
};

struct OpenedCamera {
  std::unique_ptr<sensor::RgbdCamera> camera;
  std::vector<std::string>
      notes;  ///< For the operator: what the device cannot do, what nobody has proven yet.
};

/// Opens a color camera: `config.device` is its number (of /dev/video<number>), a path, or a part of its name
/// in /dev/v4l/by-id that no other camera's name holds; empty: the only one there is.
///
/// Frames are BGR, of the size of `config` or not at all. Autofocus is switched off: intrinsics change with
/// the focus. Stamps are the driver's, mapped to `clock` by StampClock with `config.latency_s`; of a driver
/// that gives none, the arrival. `received` is when the frame came off the driver's queue.
///
/// If the camera is unplugged next() throws, each time, until it is there again under the same name.
///
/// A thread of its own reads the device, so `clock`, which must outlive the camera, must be a WallClock.
///
/// @throws Error (kHardwareAbsent) with a sentence if the camera is not there, is one of several, does not
/// open,
///   or does not offer the size; (kInvalidConfig) if the cell file wants infrared or depth of it.
OpenedCamera openCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options = {});

}  // namespace servocal::v4l2
