// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
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

/// Where one camera stands beside another: a stereo rig, or color and infrared of one RGB-D camera.
struct PairSolution {
  Eigen::Isometry3d first_by_second;  ///< Pose of the second camera in the first: takes points of the second
                                      ///< to the first, m.
  Eigen::Matrix<double, 6, 6> covariance;  ///< Of its origin (m), then of a turn about that origin (rad), along
                                      ///< the axes of the first camera.
  double rms_px = 0.0;                ///< Of both cameras' residuals together. Fit, not accuracy.
  std::vector<ViewResidual> views;    ///< Of the observations in which both see the board.
};

enum class PairStatus { kSolved, kNoCommonView, kInconsistent, kAmbiguous };
/// Sentence for the operator: what happened, and what to do about it.
const char* toString(PairStatus status);

struct PairOutcome {
  PairStatus status = PairStatus::kNoCommonView;
  std::optional<PairSolution> solution;  ///< Present only if kSolved.
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

}  // namespace servocal::calib
