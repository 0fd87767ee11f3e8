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

/// A pose against the truth, and against what is claimed of it.
struct PoseError {
  double m = 0.0, rad = 0.0;
  /// Chi-squares by the claimed covariance: of the position and of the rotation (three degrees of freedom
  /// each), and of both together (six).
  double position = 0.0, rotation = 0.0, whole = 0.0;
  double z() const;  ///< Root of the whole over its degrees of freedom.
};

/// One stream of the joint estimate. Cameras that stand in the cell.
struct JointErrors {
  std::string camera;
  Stream stream = Stream::kColor;
  PoseError pose;  ///< Of this stream's own frame in the base, at its origin.
  /// The same in the base as the arm, with its geometry as estimated, reports it: displaced and turned as
  /// fits those poses at the stops best, which no view of the board can tell from cameras that stand
  /// elsewhere.
  PoseError reported;
  double lens = 0.0;      ///< Sum over the intrinsics of the square of error over claimed standard deviation,
  int lens_size = 0;      ///< and how many there are.
  double error_px = 0.0;  ///< Worst error of projection: points of the base that are seen all over the image.
  double claim_px = 0.0;  ///< The claim of that (JointCameraResult::at_range), one sigma,
  double bound_px = 0.0;  ///< and the Cramer-Rao bound of the views taken: noise as estimated, parameters as
                          ///< they are. NaN if a view taken does not project by the truth.
  double pose_bound_m = 0.0;  ///< That of the pose: root of the trace of the origin's covariance.
};

/// Of every camera of the joint estimate.
std::vector<JointErrors> jointErrors(const CellConfig& cell, const sim::Truth& truth,
                                     const JointResult& joint, const std::vector<Observation>& observations);

}  // namespace servocal::test
