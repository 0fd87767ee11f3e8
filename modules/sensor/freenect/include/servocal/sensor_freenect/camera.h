// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::freenect {

struct OpenOptions {
  bool lock_exposure = false;  ///< Exposure and white balance keep the values they have after `settle`.
  Duration settle = std::chrono::seconds(2);
  bool raw_infrared = false;  ///< Hand out the ten bits of infrared, CV_16UC1, instead of
                              ///< sensor::infraredToEightBits().
};

struct OpenedCamera {
  std::unique_ptr<sensor::RgbdCamera> camera;
  std::vector<std::string>
      notes;  ///< For the operator: what the device cannot do, what nobody has proven yet.
};

/// Opens a Kinect v1: `config.device` is its serial number, or its number among those plugged in; empty: the
/// only one there is.
///
/// Color is BGR of 640 x 480 (30 Hz) or 1280 x 1024 (10 Hz), infrared and depth 640 x 480, depth in mm by the
/// device's own parameters, not registered, nothing mirrored. Color and infrared come from one sensor readout
/// and take turns (InfraredConfig::excludes_color must say so); depth runs beside infrared. Of the infrared
/// image's 488 rows the middle ones are handed out.
///
/// Stamps are the device's own (60 MHz, begin anew every 72 s), mapped to `clock` by StampClock with
/// `config.latency_s`. If the Kinect is unplugged next() throws, each time, until one with the same serial
/// number is there.
///
/// A thread of its own reads the device, so `clock`, which must outlive the camera, must be a WallClock.
///
/// @throws Error (kHardwareAbsent) with a sentence if the Kinect is not there, is one of several, or does not
///   open; (kInvalidConfig) if the cell file wants a size that no Kinect v1 has, or color and infrared at
///   once.
OpenedCamera openCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options = {});

}  // namespace servocal::freenect
