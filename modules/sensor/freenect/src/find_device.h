// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "servocal/core/cell_config.h"

namespace servocal::freenect {

/// The serial number of the Kinect that a cell file means.
/// @throws Error (kHardwareAbsent) if it is not there, is one of several, or may not be opened.
std::string findDevice(const CameraConfig& config);

/// Whether a Kinect of this serial number is plugged in and may be opened.
bool isPlugged(const std::string& serial);

}  // namespace servocal::freenect
