// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>

#include "servocal/core/cell_config.h"

namespace servocal::v4l2 {

/// A device node and what the kernel calls it.
struct Node {
  std::filesystem::path path;  ///< To be opened; under by-id where it has a name there.
  std::string name;            ///< "usb-046d_HD_Pro_Webcam_C920_1A2B3C4D"; empty if it has none.
};

/// The node that CameraConfig::device means. `devices` is /dev, but for tests.
/// @throws Error (kHardwareAbsent) with a sentence.
Node findNode(const CameraConfig& config, const std::filesystem::path& devices = "/dev");

}  // namespace servocal::v4l2
