// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

#include "image_file.h"
#include "servocal/core/camera_model.h"

namespace servocal::session {

/// A camera model from a ROS camera_info YAML or an OpenCV FileStorage (YAML or XML).
/// @throws Error (kBadData) naming the file if it is unreadable, its model is none of ours, or it was made
///   for images of another size.
CameraModel readIntrinsics(const std::filesystem::path& file, const ImageSize& size);

}  // namespace servocal::session
