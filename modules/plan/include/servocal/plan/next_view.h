// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"
#include "servocal/coverage/coverage.h"
#include "servocal/robot/guard.h"

namespace servocal::plan {

/// Everything the planner believes about the cell, as estimated so far.
struct Belief {
  CameraModel camera;
  Pose<Base, Color> bMc;
  Pose<EndEffector, Board> eMo;
  Mount mount = Mount::kFixed;  ///< kFlange: bMc stands for eMc, eMo for bMo (core/mount.h).
};

struct PlanOptions {
  std::vector<double> distances_m;      ///< Wanted distances along the optical axis, near first.
  double tilt_rad = 0.6;                ///< Lean of tilted candidates; below every measured tilt limit.
  double max_obliquity_rad = 1.3;       ///< Largest angle between the board's normal and the line of sight to
                                        ///< its centre: toward the image's edge a lean counts double.
  double roll_rad = 0.35;               ///< Turn in the image of rolled candidates.
  double image_margin_px = 24.0;        ///< Kept between the squares' outline and the image border.
  double min_singular_value = 0.03;     ///< Of the Jacobian on the way; below it the arm is near singular.
};

/// What the coverage stage plans with: distances by the cell file, leans that a detector bears up to `detectable_tilt_rad`.
PlanOptions coveragePlan(const CoverageConfig& config, const CameraModel& camera, double detectable_tilt_rad);

/// A view worth driving to, and how.
struct PlannedView {
  Pose<Color, Board> cdMo;
  Pose<Base, EndEffector> bMe;   ///< Where the flange will be, as far as the belief is right.
  std::optional<int> cell;       ///< The image cell it is meant for; nothing if for the marginals.
  bool via_start = false;        ///< The straight way is blocked; go back to the start pose first.
};

struct NextView {
  std::optional<PlannedView> view;  ///< Nothing if all that is missing is out of reach.
  std::vector<int> unreachable;     ///< Open cells for which no candidate can be reached.
};

/// The next view: for the open image cell nearest the image centre, of all board poses (image position,
/// distance, tilt) that put enough corners there, wholly in the image and reachable on a straight way,
/// the one that fills most of what is missing for its travel time.
///
/// @param start_q the start pose, from which views that are blocked now are tried.
/// @param tried goals driven to before; candidates close to them are not proposed again.
[[nodiscard]] NextView nextView(const coverage::Coverage& coverage, const Belief& belief,
                                const BoardSpec& board, const robot::Guard& guard,
                                const Eigen::VectorXd& current_q, const Eigen::VectorXd& start_q,
                                const std::vector<Pose<Color, Board>>& tried, const PlanOptions& options);

}  // namespace servocal::plan
