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

/// One of two cameras that look at the same board: where its views are found, and its intrinsics.
struct PairCamera {
  std::string name;
  Stream stream = Stream::kColor;
  CameraModel model;
};

enum class PairStatus { kSolved, kNoCommonView, kInconsistent, kAmbiguous, kNotConverged };
/// Sentence for the operator: what happened, and what to do about it.
const char* toString(PairStatus status);

struct PairOutcome {
  PairStatus status = PairStatus::kNoCommonView;
  std::optional<CameraPair> solution;   ///< Present only if kSolved.
};

/// The pose between two cameras from the observations in which both see the board, intrinsics given: maximum
/// likelihood of the reprojection over that pose and one board pose per observation, robust, views that stand
/// out left out and named.
///
/// Both solutions of the planar pose of either camera, and every turn of a symmetric board, are candidates;
/// the one that most observations agree on wins. One observation is enough, unless the board is symmetric:
/// then kAmbiguous, as ever when another turn would do as well.
/// The answer does not depend on the order of the observations.
///
/// @throws std::invalid_argument if a corner id is not the board's.
[[nodiscard]] PairOutcome solveCameraPair(const BoardSpec& board, const PairCamera& first, const PairCamera& second,
                                          const std::vector<Observation>& observations);

/// The same for two cameras that never saw the board at once: by where the robot says each stands. Without views;
/// the covariance takes the two hand-eye solutions as independent, though they share the robot's errors.
/// @throws std::invalid_argument if one camera stands in the cell and the other on the flange.
CameraPair pairByRobot(const PairCamera& first, const HandEyeSolution& first_stands, const PairCamera& second,
                       const HandEyeSolution& second_stands);

}  // namespace servocal::calib
