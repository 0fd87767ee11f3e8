// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/result.h"

namespace servocal::app {

/// A place where the arm would stand.
struct PlannedStop {
  std::string what;  ///< "probe 40 mm along x", "near, tilted 40 deg, for cell 3,1"
  Pose<Base, EndEffector> bMe;
  double at_s = 0.0;  ///< From the first motion on, s. An estimate.
  double clearance_m =
      0.0;  ///< Of arm and board to what is around them and to each other, the least; at most 0.1.
  std::string nearest;    ///< Which those are.
  std::string objection;  ///< Why the arm will not go there, by the guard; empty if it may.
};

/// What is planned for one camera.
struct PlannedCamera {
  std::string camera;
  std::string unknown;  ///< Why nothing can be planned; empty if it is.
  std::vector<PlannedStop> stops;
  int cells = 0;               ///< Of its color image,
  int cells_filled = 0;        ///< filled by the stops,
  int cells_out_of_reach = 0;  ///< and those that no view reaches.
};

struct DryRun {
  std::vector<PlannedStop> start;  ///< Start pose, then the probing motions or the ends of the search sweep.
  std::vector<PlannedCamera> cameras;
  double duration_s = 0.0;  ///< Of everything planned. An estimate.
};

/// Plans a run without any device. `known`: an earlier result, of which camera poses, intrinsics and the
/// board's mount are believed; without it nothing is planned beyond the surroundings of the start pose.
/// @throws Error (kInvalidConfig) from kinematics and guard.
DryRun dryRun(const CellConfig& cell, const std::optional<CalibrationResult>& known);

/// For the operator, ending with a newline: limits, boxes, stops, times and clearances.
std::string text(const CellConfig& cell, const DryRun& plan);

}  // namespace servocal::app
