// SPDX-License-Identifier: GPL-3.0-or-later
// Fits a hand-eye problem and leaves out the views that stand out.
#pragma once

#include <optional>
#include <vector>

#include "hand_eye_problem.h"
#include "hand_eye_start.h"

namespace servocal::calib {

using HandEyeFit = ArrowFit<HandEyeState>;

struct GatedFit {
  HandEyeFit fit;
  std::vector<HandEyeStop> used;
  std::vector<HandEyeStop> left_out;
};

/// Fit, leave out what stands out, fit again. Nothing if a corner cannot be projected.
std::optional<GatedFit> solveGated(HandEyeProblem& problem, const std::vector<HandEyeStop>& views,
                                   const HandEyeState& start, bool start_is_close);

/// Solves once more with the views that were left out, each in the one of its poses that is nearest.
void keepAll(const BoardSpec& board, HandEyeProblem& problem, const std::vector<HandEyeStop>& views,
             const std::vector<CandidateView>& candidates, GatedFit& solved,
             std::vector<Eigen::Isometry3d>& seen_cMo, std::vector<bool>& seen);

}  // namespace servocal::calib
