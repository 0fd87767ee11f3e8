// SPDX-License-Identifier: GPL-3.0-or-later
// Why a view was left out, in words: what its image and its robot pose betray.
#pragma once

#include <vector>

#include "hand_eye_start.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::calib {

/// Standard deviation that a detection claims for its typical corner, px; 0 if it claims none.
double claimedSigmaPx(const BoardDetection& detection);

/// A view whose corners are this many times less sharp than those of the typical view counts as blurred.
constexpr double kBlurRatio = 3.0;

/// Fills in cause and reason of a view that does not fit the board and camera of the others.
/// `sharpness_px` and `usual_rms_px` are the typical claimed sigma and residual of the views in use.
void explainImage(const BoardDetection& detection, double sharpness_px, double usual_rms_px, double rms_px,
                  ViewResidual& report);

/// One stop of the hand-eye, by view.
struct Stop {
  const BoardDetection* detection = nullptr;
  Eigen::Isometry3d lMr;  ///< As given: bMe for a fixed camera, its inverse for one on the flange.
  std::vector<BoardPoseCandidate> candidates;
};

/// Fills in cause and reason of all views that are not used. `tolerance_m` is how near two robot poses are
/// to count as the same. `reports` and `stops` have the same order.
void explainLeftOut(const BoardSpec& board, Mount mount, const Eigen::Isometry3d& lMc,
                    const Eigen::Isometry3d& rMo, double tolerance_m, const std::vector<Stop>& stops,
                    std::vector<ViewResidual>& reports);

}  // namespace servocal::calib
