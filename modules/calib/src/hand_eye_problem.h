// SPDX-License-Identifier: GPL-3.0-or-later
// The cost of a hand-eye estimate by reprojection, with a correction of every stop.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "arrow.h"
#include "board_turns.h"
#include "servocal/calib/reprojection.h"

namespace servocal::calib {

// One code for both mounts. l is the frame the camera stands in (fixed: base, flange: end effector), r the
// frame that holds the board; lMr is bMe or its inverse. The solution is lMc and rMo.

/// What a camera saw at one stop of the arm.
struct HandEyeStop {
  const BoardDetection* detection = nullptr;
  Eigen::Isometry3d lMr;
  std::size_t report = 0;  // index into HandEyeSolution::views
  int turn = 0;            // the corner ids are read as those of this turn of the board
  bool flipped = false;    // the worse fitting one of the plane's two poses was chosen
};

/// What is estimated.
struct HandEyeState {
  Eigen::Isometry3d lMc;
  Eigen::Isometry3d rMo;
  std::vector<Vector6d> corrections;  // of the flange: displacement (m), rotation vector (rad), its axes
};

/// Residuals of one view.
struct ViewCost {
  double whitened = 0.0;  // robust, the correction's prior included
  double rms_px = 0.0;
};

class HandEyeProblem {
 public:
  /// Camera and options must outlive it.
  HandEyeProblem(const BoardSpec& board, const CameraModel& camera, const ReprojectionOptions& options);

  void setViews(std::vector<HandEyeStop> views);
  /// How far each stop's robot pose is believed, 0 to 1; all alike until the next setViews.
  void setBelief(std::vector<double> belief) { belief_ = std::move(belief); }
  const std::vector<HandEyeStop>& views() const { return views_; }
  const BoardTurns& turns() const { return turns_; }
  void setScale(double scale) { scale_ = scale; }
  double scale() const { return scale_; }

  /// Nothing if a corner cannot be projected.
  std::optional<ArrowSystem> linearize(const HandEyeState& state) const;

  HandEyeState move(const HandEyeState& state, const ArrowStep& step) const;

  /// Nothing if a corner cannot be projected.
  std::optional<ViewCost> viewCost(const HandEyeState& state, const HandEyeStop& view,
                                   const Vector6d& correction) const;

  /// A correction in standard deviations of the robot.
  Vector6d whitened(const Vector6d& correction) const { return prior_root_.cwiseProduct(correction); }

  /// cMo of a view with its stop corrected.
  Eigen::Isometry3d boardPose(const HandEyeState& state, const HandEyeStop& view,
                              const Vector6d& correction) const;

 private:
  const Eigen::Vector3d& pointOf(const HandEyeStop& view, const Corner& corner) const {
    return points_o_[static_cast<std::size_t>(turns_.id(corner.id, view.turn))];
  }

  const CameraModel& camera_;
  const ReprojectionOptions& options_;
  std::vector<Eigen::Vector3d> points_o_;
  BoardTurns turns_;
  Vector6d prior_root_;
  std::vector<HandEyeStop> views_;
  std::vector<double> belief_;
  std::vector<std::vector<Eigen::Matrix2d>> weights_;
  double scale_ = 1.0;
};

}  // namespace servocal::calib
