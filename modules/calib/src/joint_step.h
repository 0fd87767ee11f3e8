// SPDX-License-Identifier: GPL-3.0-or-later
// Did a camera or the board move during the run?
#pragma once

#include <string>

#include "joint_problem.h"

namespace servocal::calib {

/// The step that explains most: what moved, when, by how much.
struct JointStep {
  double chi_square = 0.0;            // beyond what the arm can fake
  std::size_t stop = 0;               // the first after it
  std::string camera;                 // empty: the board
  Vector6d moved = Vector6d::Zero();  // displacement of its origin (m), turn about it (rad)
};

/// Score test of a step of the board and of each camera (all its streams together) at each of the stops, all
/// else free. Errors of an arm are smooth: in a part of the workspace they look like another pose of whatever
/// is there. A step has to stand out from what the declared accuracy allows of that, and to be seen from five
/// stops on either side, which both must tell of every direction. `solution` is where the state comes from,
/// its covariance finite.
JointStep bestStep(const JointProblem& problem, const JointState& state, const JointSolution& solution);

}  // namespace servocal::calib
