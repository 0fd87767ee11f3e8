// SPDX-License-Identifier: GPL-3.0-or-later
// From the solved problem to what a person reads.
#pragma once

#include <vector>

#include "joint_noise.h"
#include "joint_problem.h"
#include "joint_start.h"

namespace servocal::calib {

using JointFit = ArrowFit<JointState>;

struct JointSolved {
  JointFit fit;
  NoiseEstimate noise;
};

/// Appends solution.cameras: residuals of all views, causes of those left out.
void reportCameras(const BoardSpec& board, const JointProblem& problem, const JointSolved& solved,
                   const std::vector<JointViewStart>& views, JointSolution& solution);

/// Fills in robot, stops, and a note where the declared noise is far from what was found.
void reportRobot(const JointProblem& problem, const JointSolved& solved, const JointCovariance& covariance,
                 JointSolution& solution);

}  // namespace servocal::calib
