// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::calib {

struct DepthOptions {
  int nodes_x = 8;               ///< Of the lattice, each at least 2.
  int nodes_y = 6;
  int min_views = 5;
  double min_range_ratio = 1.1;  ///< Farthest over nearest board; below, the slope stays 1.
  double max_scatter_m = 0.02;   ///< Common error of a view's depth, 1 sigma, above which the answer is refused.
  /// Better board poses than one infrared image gives, by observation id; e.g. from hand-eye and robot. Views
  /// without one fall back to their image.
  std::map<std::int64_t, Pose<Infrared, Board>> board_poses;
  double board_pose_sigma_m = 0.0003;     ///< Standard deviations of board_poses, per axis and view,
  double board_pose_sigma_rad = 0.0005;   ///< independent from view to view.
  /// Standard deviation of what all board_poses have wrong alike, along the line of sight: part of DepthResult::sigma_m.
  double board_pose_common_m = 0.0;
  /// Of infrared.parameters (IntrinsicsResult::covariance). If given, DepthResult::sigma_m includes what the
  /// intrinsics do to the boards' distances: usually its largest part. Not used with board_poses.
  std::optional<Eigen::MatrixXd> intrinsics_covariance;
};

enum class DepthStatus { kSolved, kTooFewViews, kInconsistent };
/// Sentence for the operator: what happened, and what to do about it.
const char* toString(DepthStatus status);

struct DepthOutcome {
  DepthStatus status = DepthStatus::kTooFewViews;
  std::string reason;                 ///< The same with this set's numbers; empty if kSolved.
  std::optional<DepthResult> result;  ///< Present only if kSolved.
  std::vector<std::int64_t> left_out; ///< Observations whose depth contradicts the others'.
};

/// The depth correction (DepthModel) of one camera: its raw depth patches against the plane of the board by the
/// corners in the same infrared images, or by given board poses.
///
/// Linear least squares over offset, slope and lattice, in inverse depth (structured light) or range (time of
/// flight). Errors of a view are correlated: the board pose moves all its patches together. The covariance of
/// each view is that of its patches, of the pose by its corners (or as given), and of one common error of the
/// view's depth; its size, a factor on the patches' sigmas, the stiffness of the lattice and the size of the wiggling
/// error maximize the evidence. The latter is a stationary process over the range, so that it fades where no board
/// was; data without one make it zero. The slope of time of flight is known beforehand to 0.003. The lattice is a
/// membrane (differences of neighboring nodes are random) of mean zero over the image, so that the offset is determined; where no board was it continues its surroundings, with the
/// uncertainty that the stiffness implies. With boards at one distance only, slope and wiggling are not
/// determined and stay 1 and 0, with a note. Up to a third of the views may contradict the others; they are left out
/// and named. What the correction does not know yet, where no other view was, is no contradiction.
///
/// Of the two poses of a plane that fit a small image alike, the one whose plane fits the depth is taken.
///
/// Sources: as DepthModel; evidence: MacKay, "Bayesian Interpolation", Neural Computation 4(3), 1992.
///
/// @throws std::invalid_argument if a corner id is not the board's, an option is out of range, or a patch's
///   numbers are not finite and positive.
[[nodiscard]] DepthOutcome solveDepth(const BoardSpec& board, const CameraModel& infrared,
                                      const std::vector<Observation>& observations, const std::string& camera,
                                      DepthSensor sensor, const DepthOptions& options = {});

}  // namespace servocal::calib
