// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::openni2 {

struct OpenOptions {
  bool lock_exposure = false;  ///< Exposure and white balance keep the values they have after `settle`.
  Duration settle = std::chrono::seconds(2);
  bool raw_infrared =
      false;  ///< Hand out infrared as it comes, CV_16UC1, instead of sensor::infraredToEightBits().
  /// Not empty: an .oni file to which every frame of the device goes while the camera is open (recording.h reads it);
  /// replaced if it is there. Streams that OpenNI2 could not play (color of 1920 x 1080) are left out, with a note.
  /// Once unplugged, such a camera stays away.
  std::filesystem::path record;
};

/// A device as OpenNI2 lists it.
struct Device {
  std::string uri;
  std::string vendor;
  std::string name;
  std::string serial;  ///< Empty if its driver does not tell.
};
/// The devices that the installed OpenNI2 drivers see now.
/// @throws Error (kHardwareAbsent) if OpenNI2 does not start.
std::vector<Device> devices();

struct OpenedCamera {
  std::unique_ptr<sensor::RgbdCamera> camera;
  std::vector<std::string>
      notes;  ///< For the operator: what the device cannot do, what nobody has proven yet.
};

/// Opens an OpenNI2 device: `config.device` is its serial number or its URI; empty: the only one there is.
///
/// Streams run at the modes of `config` from the first time that next() asks for them; streams that exclude
/// each other (InfraredConfig::excludes_color) take turns, and of those only frames that were exposed after
/// the change are handed out. Mirroring and registration are switched off, depth and color exposures are
/// coupled where the device offers that. Color is BGR; depth is in mm whatever the device's unit; device
/// stamps are mapped to `clock` by StampClock with `config.latency_s`.
///
/// Waiting is sleeping on `clock` in steps of a millisecond, so a simulated run waits for no wall time.
///
/// If the device is unplugged next() throws, each time, until a device with the same serial number (or, if it
/// tells none, the same URI) is there: that is opened and set up as the first one was.
///
/// `clock` must outlive the camera. For one thread.
///
/// @throws Error (kHardwareAbsent) with a sentence if the device is not there, is one of several, or has no
/// such
///   stream or mode; names a Kinect that is plugged in without a driver for it. kBadData if nothing can be recorded to
///   `options.record`.
OpenedCamera openCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options = {});

}  // namespace servocal::openni2
