// SPDX-License-Identifier: GPL-3.0-or-later
// The joint problem at a solution, over any observations.
#pragma once

#include <vector>

#include "joint_problem.h"

namespace servocal::calib {

/// Parameters, their order, and noise are those of the solution; corrections are zero and all views are in.
class JointPrediction {
 public:
  JointPrediction(const BoardSpec& board, const std::vector<Observation>& observations,
                  const JointSolution& solution);
  JointPrediction(const JointPrediction&) = delete;
  JointPrediction& operator=(const JointPrediction&) = delete;

  /// Back to where the solution was made: its corrections, and the views it used. For its own observations.
  void restore(const JointSolution& solution);

  const JointProblem& problem() const { return problem_; }
  JointProblem& problem() { return problem_; }
  const JointState& state() const { return state_; }

 private:
  JointOptions options_;
  JointProblem problem_;
  JointState state_;
};

}  // namespace servocal::calib
