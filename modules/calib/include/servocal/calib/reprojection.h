// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/calib/hand_eye.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::calib {

struct ReprojectionOptions {
  Mount mount = Mount::kFixed;
  double robot_sigma_m = 0.0003;     ///< Robot noise per axis and stop, position
  double robot_sigma_rad = 0.0005;   ///< and rotation: accuracy over the volume, not repeatability.
  double huber_sigma = 2.5;          ///< Robust loss per corner starts here, in standard deviations.
};

struct HandEyeOutcome {
  HandEyeStatus status = HandEyeStatus::kTooFewViews;
  double axis_spread = 0.0;
  std::optional<HandEyeSolution> solution;  ///< Present only if kSolved.
};

/// The accumulated hand-eye estimate: closed form on board poses (both planar solutions kept, and the
/// 180 degree turn of a board without a mark, decided by consistency with the robot), then maximum
/// likelihood of the reprojection with one small robot-pose correction per stop in the cost. Intrinsics
/// are given and stay fixed.
///
/// Uses the observations that have a robot state and a view of `camera` and `stream`.
///
/// Source: cost as in M. Shah et al. / Koide & Menegatti, "General Hand-Eye Calibration Based on
/// Reprojection Error Minimization", IEEE RA-L 4(2), 2019, with the robot's noise added.
[[nodiscard]] HandEyeOutcome solveHandEyeReprojection(const BoardSpec& board, const CameraModel& camera,
                                                      const std::vector<Observation>& observations,
                                                      const std::string& camera_name, Stream stream,
                                                      const ReprojectionOptions& options = {});

}  // namespace servocal::calib
