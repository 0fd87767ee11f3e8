// SPDX-License-Identifier: GPL-3.0-or-later
// Where the joint solve starts: intrinsics stream by stream, the hand-eye of the stream that saw most, the
// other cameras from the board pose it gives.
#pragma once

#include <string>
#include <vector>

#include "joint_problem.h"

namespace servocal::calib {

/// The observations that the solve takes, sorted by id, with a name for people and what the images alone say.
struct JointViewStart {
  JointView view;
  std::string name;
  bool used = true;
  std::string reason;  ///< Empty unless the image itself is at fault.
  ViewCause cause = ViewCause::kNone;
};

struct JointStart {
  JointStatus status = JointStatus::kTooFewViews;
  double axis_spread = 0.0;
  JointState state;                   ///< Set, like the rest, only if kSolved. Corrections are zero.
  std::vector<JointViewStart> views;  ///< By stop, then camera.
};

/// One per observation with a robot pose and a view of one of the streams.
std::vector<JointStop> jointStops(const std::vector<Observation>& observations, const JointOptions& options);

/// All views of the problem's stops, the turn of a symmetric board chosen to fit the state.
std::vector<JointView> jointViews(const JointProblem& problem, const JointState& state);

/// `observations` sorted by id; `problem` over jointStops of these.
JointStart startJoint(const BoardSpec& board, const std::vector<Observation>& observations,
                      const JointProblem& problem);

}  // namespace servocal::calib
