// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servocal/calib/diagnose.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::procedure {

/// Intrinsics by camera and stream, believed instead of solved.
using GivenIntrinsics = std::map<std::pair<std::string, Stream>, CameraModel>;

/// Observations of this stage are kept from the solvers: they give the held-out error.
inline constexpr const char* kCheckStage = "check";

struct SolveOptions {
  calib::IntrinsicsOptions intrinsics;
  Mount mount = Mount::kFixed;
  double robot_sigma_m = 0.0003;    ///< Declared robot noise per axis and stop.
  double robot_sigma_rad = 0.0005;
  GivenIntrinsics given_intrinsics;
  std::map<std::string, DepthSensor> depth_sensors;  ///< By camera; depth is solved for these.
  std::optional<ArmConfig> arm;    ///< Its kinematics: the joint estimate may correct its geometry.
  std::optional<Box> workspace;    ///< Where the joint estimate maps the error of points; nothing: where the board was.
  std::string poses_from = "the robot poses";   ///< What robot poses are called in messages.
  std::vector<calib::RobotReading> readings;    ///< Tried to explain a contradiction; see explainContradiction.
  bool refuse_contradictions = false;           ///< Throw where robot and images contradict each other.
};

/// Every camera's, color and infrared, of an earlier result.
GivenIntrinsics intrinsicsOf(const CalibrationResult& result);

/// Of the cameras of a cell that measure depth.
std::map<std::string, DepthSensor> depthSensors(const CellConfig& cell);

/// Solves a set of observations, live or recorded: for every camera that occurs in them, Zhang's
/// intrinsics of color and of infrared, then, where there are robot poses, the hand-eye; the pose between
/// color and infrared and the depth correction; and the poses of the other cameras in the first. What cannot be determined is missing from the result and named in CalibrationResult::missing;
/// goal_met says whether nothing is. Where there are robot poses, the joint estimate of the whole cell stands beside it
/// (CalibrationResult::joint); goal_met does not ask it. An observation without any view (no board in its image) is listed among
/// the views that were not used. Where views were left out, the result with them stands beside
/// (CameraResult::intrinsics_with_outliers).
///
/// A contradiction between robot and images (no common solution; fewer than 80 % of the views agree and there
/// is a way to read the poses in which they do; or the board is off by more than 10 % and 5 sigma by the
/// robot's motion) is named with its likely cause, in CalibrationResult::missing or as an error.
///
/// @throws Error (kBadData) for a contradiction, if options.refuse_contradictions.
CalibrationResult solve(const BoardSpec& board, const std::vector<Observation>& observations,
                        const SolveOptions& options = {});

}  // namespace servocal::procedure
