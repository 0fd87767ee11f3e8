// SPDX-License-Identifier: GPL-3.0-or-later
// The joint estimate of a whole cell, beside the one in stages.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "servocal/calib/board_places.h"
#include "servocal/calib/joint.h"
#include "servocal/core/result.h"
#include "servocal/procedure/solve.h"

namespace servocal::procedure {

/// The streams with enough views to be solved, the lens as asked, a flat board; the others are named in `notes`.
calib::JointOptions jointOptions(const std::vector<Observation>& observations, const SolveOptions& options,
                                 std::vector<std::string>& notes);

/// What may be wrong with the arm's geometry, if the cell says what arm it is and every stop has its joint angles.
std::optional<calib::RobotTerms> geometryTerms(const std::vector<Observation>& observations, const SolveOptions& options,
                                               std::vector<std::string>& notes);

struct JointAnswer {
  std::optional<JointResult> result;
  std::string problem;  ///< Why there is none, a sentence; empty too if there are no robot poses.
  std::map<std::string, calib::BoardPlaces> infrared_boards;  ///< By camera, of those that measure depth.
};

/// Everything at once: which lens terms, whether a bow of the board and errors of the arm's geometry by
/// cross-validation (calib::selectModel), then calib::solveJoint, the maps, who is to blame for what does not
/// fit, and the error in `kept`, which only this looks at. Without any of `kept` that error is that of the
/// cross-validation. Never throws for what the data are.
JointAnswer solveJointly(const BoardSpec& board, const std::vector<Observation>& observations,
                         const std::vector<Observation>& kept, const SolveOptions& options);

}  // namespace servocal::procedure
