// SPDX-License-Identifier: GPL-3.0-or-later
// A joint estimate against the truth of a simulated cell, and against what its views can tell at best.
#pragma once

#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/result.h"

namespace servocal::sim {
class Truth;
}

namespace servocal::test {

/// One stream of the joint estimate. Cameras that stand in the cell.
struct JointErrors {
  std::string camera;
  Stream stream = Stream::kColor;
  double pose_m = 0.0;  ///< Of this stream's own frame in the base, at its origin.
  double pose_rad = 0.0;
  double pose_z = 0.0;  ///< Root of the pose error's chi-square by the claimed covariance over its 6 degrees.
  /// The same three in the base as the arm, with its geometry as estimated, reports it: displaced and turned as fits
  /// those poses at the stops best, which no view of the board can tell from cameras that stand elsewhere.
  double reported_m = 0.0, reported_rad = 0.0, reported_z = 0.0;
  double error_px = 0.0;  ///< Worst error of projection: points of the base that are seen all over the image.
  double claim_px = 0.0;  ///< The claim of that (JointCameraResult::at_range), one sigma,
  double bound_px = 0.0;  ///< and the Cramer-Rao bound of the views taken: noise as estimated, parameters as
                          ///< they are. NaN if a view taken does not project by the truth.
  double pose_bound_m = 0.0;  ///< That of the pose: root of the trace of the origin's covariance.
};

/// Of every camera of the joint estimate; nothing if there is none.
std::vector<JointErrors> jointErrors(const CellConfig& cell, const sim::Truth& truth,
                                     const CalibrationResult& result,
                                     const std::vector<Observation>& observations);

}  // namespace servocal::test
