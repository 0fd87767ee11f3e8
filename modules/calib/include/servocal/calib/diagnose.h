// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::calib {

/// Another way to read the robot's poses.
struct RobotReading {
  std::string what;                                         ///< Completes "robot and images agree if ...".
  std::vector<std::optional<Pose<Base, EndEffector>>> bMe;  ///< Per observation; nothing where it has none.
};

/// Size of the board's pattern by the robot's motion: the closed form with one length scale between board
/// and robot free. Nothing if the views do not determine it or do not agree on one solution.
///
/// The standard deviation is that of the residuals. It knows nothing of an error that all views share: a
/// focal length off by 1 % moves the scale by up to 1 %.
///
/// @throws std::invalid_argument if a robot pose is not finite or a corner id is not the board's.
std::optional<BoardScale> boardScale(const BoardSpec& board, const CameraModel& camera,
                                     const std::vector<Observation>& observations,
                                     const std::string& camera_name, Stream stream, Mount mount);

/// Size of the board's pattern by the depth of one camera's infrared views: the ratio of measured depth to where
/// the corners put the board's plane, its median over at least three views. Nothing if there are fewer.
///
/// The standard deviation is that of the views' scatter. It knows neither an error of the focal length nor the
/// sensor's own: 24 mm, as a time-of-flight camera has them, are 5 % at 0.5 m.
///
/// @throws std::invalid_argument if a corner id is not the board's, or a patch is not finite and positive.
std::optional<BoardScale> boardScaleByDepth(const BoardSpec& board, const CameraModel& infrared,
                                            const std::vector<Observation>& observations,
                                            const std::string& camera_name);

/// Why robot poses and images contradict each other, where the data betray it: a clause that completes
/// "robot and images agree if ...". Nothing if they agree as they are, or in no way that is tried.
///
/// Tried are: the poses inverted (which is the same geometry as the camera on the other mount; the clause
/// says both), their rotations transposed, every one of `readings`, and each of these with the size of the
/// board free, which betrays wrong units of length or a wrong square size. A way counts if 80 % of the views
/// agree with it to 2 degrees and 1.5 % of the distance, and at least three times better than as given. It is
/// named, never applied.
///
/// @throws std::invalid_argument as boardScale, or if a reading has another number of poses than there are
///   observations.
std::optional<std::string> explainContradiction(const BoardSpec& board, const CameraModel& camera,
                                                const std::vector<Observation>& observations,
                                                const std::string& camera_name, Stream stream, Mount mount,
                                                const std::vector<RobotReading>& readings = {});

/// "the squares measure 25.10 mm by the robot's motion, not 30 mm" (or tags, spacing of circles; or by what else).
std::string sizeText(const BoardSpec& board, double scale, const std::string& by = "the robot's motion");

}  // namespace servocal::calib
