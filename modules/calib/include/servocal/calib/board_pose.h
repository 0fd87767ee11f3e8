// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/pose.h"

namespace servocal::calib {

/// A pose of the board that explains one image.
struct BoardPose {
  Pose<Color, Board> cMo;
  double rms_px = 0.0;  ///< Root mean square length of the residual, px.
};

/// Both solutions of the planar pose problem, best first, each refined by reprojection. A plane seen
/// from afar has two poses that fit almost equally; the robot decides which one is real. Empty if there
/// are fewer than four corners or none can be unprojected.
///
/// Source: Collins & Bartoli, "Infinitesimal Plane-Based Pose Estimation", IJCV 109, 2014 (via OpenCV's
/// SOLVEPNP_IPPE); refinement by Gauss-Newton on our own camera model.
std::vector<BoardPose> boardPoses(const BoardSpec& board, const CameraModel& camera,
                                  const BoardDetection& detection);

}  // namespace servocal::calib
