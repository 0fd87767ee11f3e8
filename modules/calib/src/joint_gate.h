// SPDX-License-Identifier: GPL-3.0-or-later
// Which views have a say in the joint solve.
#pragma once

#include <vector>

#include "joint_problem.h"
#include "joint_start.h"

namespace servocal::calib {

/// Judges every view at `state`, those that are out too, and says which ones are to stay.
///
/// A view stands out beyond the spread of the others of its camera, or its stop needs a correction that is no
/// robot noise. Where several cameras saw a stop that stands out, each is asked alone with the robot: a wrong
/// image shows in one of them, a wrong robot pose in all. A view that was out comes back in if it fits well.
std::vector<bool> judgeViews(const JointProblem& problem, const JointState& state,
                             const std::vector<JointViewStart>& views);

}  // namespace servocal::calib
