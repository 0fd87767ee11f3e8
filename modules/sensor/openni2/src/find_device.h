// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "library.h"
#include "servocal/core/cell_config.h"

namespace servocal::openni2 {

/// For the operator: "Microsoft Kinect, serial A1B2, uri".
std::string describe(const Device& device);

/// The device that a cell file means.
/// @throws Error (kHardwareAbsent) if it is not there, or one of several.
Device findDevice(const Library& library, const CameraConfig& config);

}  // namespace servocal::openni2
