// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <vector>

#include "servocal/calib/joint.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/observation.h"

namespace servocal::calib {

/// Where the board was in one camera, by everything that a joint solution knows.
struct BoardPlaces {
  std::map<std::int64_t, Eigen::Isometry3d> poses;  ///< cMo by observation id, of the views in use.
  double sigma_m = 0.0;    ///< Standard deviation per axis of the stop's own error; RMS over the stops.
  double sigma_rad = 0.0;  ///< Likewise per axis of its rotation.
  /// Of their depths' mean, along the lines of sight: what the poses of camera and mount have wrong in all views alike, to
  /// first order. NaN if it is not known.
  double common_m = 0.0;
};

/// The places of the board at the stops that the solution used of this camera, each stop's correction
/// included.
///
/// A depth correction takes them for the truth: one image of 512 x 424 px knows a distance to a millimetre or
/// two, and the intrinsics of one stream, by images alone, stretch all of them alike.
///
/// @param observations those that the solution was made from.
/// @param camera one of solution.cameras.
/// @throws std::invalid_argument as solveJoint.
[[nodiscard]] BoardPlaces boardPlaces(const BoardSpec& board, const std::vector<Observation>& observations,
                                      const JointSolution& solution, const JointCamera& camera);

}  // namespace servocal::calib
