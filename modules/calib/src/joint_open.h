// SPDX-License-Identifier: GPL-3.0-or-later
// What the data of a joint solve leave open, in plain words.
#pragma once

#include <vector>

#include "joint_problem.h"

namespace servocal::calib {

/// Directions of the cameras' and the board's pose parameters and of the intrinsics whose standard deviation
/// is more than options.undetermined_share of what is known beforehand, worst first. The board's shape and
/// the robot's terms carry priors: what the data do not say of them is in their standard deviations.
/// `covariance` is that of the shared parameters with the anchor in it.
std::vector<OpenDirection> openDirections(const JointProblem& problem, const JointState& state,
                                          const Eigen::MatrixXd& covariance);

/// Per shared parameter: neither data nor a prior determine it.
std::vector<bool> undetermined(const JointProblem& problem, const JointState& state,
                               const Eigen::MatrixXd& covariance);

}  // namespace servocal::calib
