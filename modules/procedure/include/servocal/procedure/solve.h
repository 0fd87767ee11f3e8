// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>
#include <string>
#include <vector>

#include "servocal/calib/diagnose.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::procedure {

struct SolveOptions {
  calib::IntrinsicsOptions intrinsics;
  Mount mount = Mount::kFixed;
  double robot_sigma_m = 0.0003;    ///< Declared robot noise per axis and stop.
  double robot_sigma_rad = 0.0005;
  std::map<std::string, CameraModel> given_intrinsics;  ///< By camera; believed instead of solved.
  std::string poses_from = "the robot poses";   ///< What robot poses are called in messages.
  std::vector<calib::RobotReading> readings;    ///< Tried to explain a contradiction; see explainContradiction.
  bool refuse_contradictions = false;           ///< Throw where robot and images contradict each other.
};

/// Solves a set of observations, live or recorded: for every camera that occurs in them, Zhang's
/// intrinsics, then, where there are robot poses, the hand-eye; and the poses of the other cameras in the
/// first. What cannot be determined is missing from the result and named in CalibrationResult::missing;
/// goal_met says whether nothing is. An observation without any view (no board in its image) is listed among
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
