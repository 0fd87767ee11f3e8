// SPDX-License-Identifier: GPL-3.0-or-later
// Two cameras of one calibration against each other, by the truth of a simulated cell.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "plane_gaps.h"
#include "servocal/core/result.h"
#include "sim_truth.h"

namespace servocal::test {

/// Of an estimate of where two cameras stand. Points are a grid of 0.3 m around where the board was at the
/// start.
struct PairError {
  double first_m = 0.0;    ///< A point that is measured in the camera without error, in the base: RMS of what
  double second_m = 0.0;   ///< it is off by, through the first camera's pose and the second's,
  double between_m = 0.0;  ///< and of what the two differ by.
  double pose_m = 0.0;     ///< The second camera's pose in the first, at its origin.
  double pose_rad = 0.0;
};

struct CameraPairErrors {
  std::string first;
  std::string second;
  PairError staged;
  std::optional<PairError> joint;
  std::vector<PlaneGap> raw, corrected;  ///< By place, result in stages; empty unless both measure depth by time of flight.
  std::vector<PlaneGap> best;  ///< The same by the best estimate, as programs use it.
};

/// Every two cameras that stand in the cell and have a hand-eye.
std::vector<CameraPairErrors> pairErrors(const sim::Truth& truth, const CalibrationResult& result,
                                         const std::vector<PlaneShot>& shots,
                                         const Eigen::Vector3d& board_at_start);

}  // namespace servocal::test
