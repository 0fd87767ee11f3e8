// SPDX-License-Identifier: GPL-3.0-or-later
// When a run whose planner goes by information has seen enough.
#pragma once

#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/joint_result.h"

namespace servocal::procedure {

/// How well one stream is known, one sigma.
struct Known {
  std::string name;          // "left color"
  double projection_px = 0;  // worst over the image, at infinity and at the working range
  double point_m = 0;        // worst over what it sees of the workspace
};

/// What is not yet known as well as the cell file wants, a sentence each.
std::vector<std::string> goalsMissed(const std::vector<Known>& streams, const PlannerConfig& goals);

/// The same of a finished joint estimate, and whether it may be believed: views it has not seen, and its two halves.
std::vector<std::string> goalsMissed(const JointResult& joint, const PlannerConfig& goals);

}  // namespace servocal::procedure
