// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"
#include "servocal/session/image_set.h"
#include "servocal/session/session.h"

namespace servocal::procedure {

/// What a person may choose for input that carries its own description.
struct SolveOverrides {
  std::optional<LensModel> lens;
  std::optional<std::vector<std::string>> fixed;  ///< Distortion parameters held at zero, by name.
};

/// Looks for the board in every image of a set. An image without a board becomes an observation without
/// views: its robot pose stays with it and is used by nobody. Observations are numbered as the images.
/// @throws Error (kBadData) if an image cannot be read.
std::vector<Observation> detectImages(const session::ImageSet& images);

/// The images of one camera, or of several that took them together, from manifest to result. All have one
/// lens model.
/// @throws Error as detectImages; (kBadData) also if robot poses and images contradict each other, or if a board
///   with rows and columns swapped, or one square larger each way, is what the images show. The message says
///   which mistake makes them agree, if one does.
CalibrationResult solveImages(const std::vector<session::ImageSet>& cameras, const SolveOverrides& overrides = {});

/// A recorded session, from its stored detections; mount and robot accuracy are those of its cell file.
/// @throws Error (kNothingToDo) if it holds no observation, (kBadData) if it cannot be read or robot poses and
///   images contradict each other, (kInvalidConfig) if its cell file cannot be, or has cameras of both mounts.
CalibrationResult solveRecorded(const session::Session& recorded, const SolveOverrides& overrides = {});

}  // namespace servocal::procedure
