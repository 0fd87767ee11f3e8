// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"

namespace servocal {

/// How one view fits the solution.
struct ViewResidual {
  std::int64_t observation_id = 0;
  std::string name;        ///< Image file or stage.
  double rms_px = 0.0;     ///< Over the view's corners, length of the 2-vector.
  bool used = true;
  std::string reason;      ///< Why it was not used; empty if it was.
};

/// Intrinsics by Zhang's method: from images alone, the robot is not asked.
struct IntrinsicsResult {
  CameraModel camera;
  Eigen::VectorXd sigma;         ///< Standard deviations, order and units of camera.parameters.
  Eigen::MatrixXd covariance;
  double rms_px = 0.0;           ///< Root mean square length of the residual. Fit, not accuracy.
  int corners = 0;
  std::vector<ViewResidual> views;
};

/// Where a camera stands, by reprojection with the robot's noise in the cost.
struct HandEyeSolution {
  Mount mount = Mount::kFixed;
  Eigen::Isometry3d camera_pose;   ///< kFixed: bMc. kFlange: eMc.
  Eigen::Isometry3d board_pose;    ///< kFixed: eMo. kFlange: bMo.
  Eigen::Matrix<double, 6, 1> camera_sigma;  ///< Standard deviations along the axes of camera_pose's left
                                   ///< frame: of its origin (m), then of a turn about that origin (rad).
  Eigen::Matrix<double, 6, 1> board_sigma;   ///< Likewise for board_pose.
  double rms_px = 0.0;             ///< Residual with each stop's pose corrected within robot noise.
  double robot_rms_m = 0.0;        ///< RMS of those corrections.
  double robot_rms_rad = 0.0;
  double scatter_m = 0.0;          ///< RMS spread of the board pose that ought to be constant, robot
  double scatter_rad = 0.0;        ///< believed.
  std::vector<ViewResidual> views;
};

struct TiltLimit {
  std::string direction;      ///< "roll+", "roll-", "pitch+", ...
  double limit_rad = 0.0;     ///< Largest angle at which the board was still detected.
  std::string ended_by;       ///< "detection", "cap", "reach".
};

struct CoverageSummary {
  int cells_x = 0;
  int cells_y = 0;
  std::vector<int> corners_per_cell;  ///< Row by row.
  std::vector<bool> unreachable;      ///< Row by row; given up after tries.
  int corners_to_fill = 0;
  int near_views = 0;
  int far_views = 0;
  std::vector<std::pair<std::string, int>> tilt_bins;
};

/// Everything about one camera.
struct CameraResult {
  std::string camera;
  IntrinsicsResult intrinsics;
  std::optional<HandEyeSolution> hand_eye;
  std::optional<CoverageSummary> coverage;
  std::vector<TiltLimit> tilt_limits;
};

/// What a run ends with; see docs/result-schema.md.
struct CalibrationResult {
  int schema_version = 1;
  bool goal_met = false;
  std::vector<std::string> missing;  ///< What the goal lacks, a sentence each; empty if goal_met.
  BoardSpec board;
  std::vector<CameraResult> cameras;
  double motion_time_s = 0.0;        ///< First to last motion, tilt search included.
  double tilt_time_s = 0.0;          ///< Of which tilt search.
  int observations = 0;
  std::string provenance;            ///< Program version, seed, session.
};

}  // namespace servocal
