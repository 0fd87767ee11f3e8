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
  HandEyeOptions closed_form;        ///< When to refuse.
  bool keep_outliers = false;        ///< Views found to stand out are named but used all the same: for
                                     ///< comparison, to see what they do to the answer.
  /// An earlier solution of this mount, to start from: a fraction of the time. It is dropped for the
  /// closed form if the views contradict it (a camera that was bumped).
  std::optional<HandEyeSolution> start;
};

struct HandEyeOutcome {
  HandEyeStatus status = HandEyeStatus::kTooFewViews;
  double axis_spread = 0.0;
  std::optional<HandEyeSolution> solution;  ///< Present only if kSolved.
};

/// The accumulated hand-eye estimate: closed form on board poses (both planar solutions kept, and every
/// turn of a board that looks the same after it, decided by consistency with the robot), then maximum
/// likelihood of the reprojection with one small robot-pose correction per stop in the cost:
///
///   sum over views i, corners j of huber(|W_ij (project(cMb bMe_i C_i eMo X_j) - z_ij)| / s)
///     + sum over i of |c_i|^2 / robot_sigma_m^2 + |w_i|^2 / robot_sigma_rad^2
///
/// C_i = [exp(w_i), c_i] displaces and turns the flange of stop i along and about its own axes; W_ij
/// whitens with the corner's covariance. For a camera on the flange the chain is cMe C_i eMb_i bMo X_j.
/// The scale s is estimated so that the typical view has a chi-square of one per degree of freedom: where
/// the intrinsics are still rough, their error counts as corner noise instead of bending the robot. A view
/// that then still stands out is left out and named, with the cause that its image and its robot pose
/// betray: ViewResidual::cause and reason. Intrinsics are given and stay fixed.
///
/// Uses the observations that have a robot state and a view of `camera_name` and `stream`. For a board
/// without a mark one turn about its normal, common to all views, stays open; the result is the one in
/// which the first used view has the ids it came with. With options.start, HandEyeSolution::resolved_flips
/// is not counted: the pose nearest to the prediction is taken unseen of the other.
///
/// Source: cost as in K. Koide & E. Menegatti, "General Hand-Eye Calibration Based on Reprojection Error
/// Minimization", IEEE RA-L 4(2), 2019, with the robot's noise added.
///
/// @throws std::invalid_argument if a robot pose is not finite, a corner id is not the board's, a sigma is
///   not positive, or options.start is of another mount.
[[nodiscard]] HandEyeOutcome solveHandEyeReprojection(const BoardSpec& board, const CameraModel& camera,
                                                      const std::vector<Observation>& observations,
                                                      const std::string& camera_name, Stream stream,
                                                      const ReprojectionOptions& options = {});

}  // namespace servocal::calib
