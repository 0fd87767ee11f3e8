// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "servocal/calib/joint.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"

namespace servocal::calib {

/// A stop that has not been made.
struct PlannedStop {
  struct Look {
    std::size_t camera = 0;    ///< Index into JointSolution::cameras
    double probability = 1.0;  ///< that it will detect the board.
  };
  Pose<Base, EndEffector> bMe;  ///< Where the flange would be.
  std::vector<Look> looks;
};

struct ForecastOptions {
  Box workspace;         ///< Where points have to be known, in the frame the cameras stand in.
  double range_m = 0.6;  ///< Working distance, at which projections have to be known too.
  /// What is known better than this all over an image, or of all points that a stream sees, counts for
  /// little.
  double projection_goal_px = 0.0;
  double point_goal_m = 0.0;
};

/// What would be left uncertain of a joint solution after stops that have not been made, to first order, the
/// intrinsics' lens model believed.
///
/// A stop counts by what it takes away from the variance of projection (over every stream's image, at
/// infinity and at the working distance) and of points of the workspace:
///
///   gain = sum over streams of w_I log(tr(A_I S) / tr(A_I S')) + w_3 log(tr(A_3 S) / tr(A_3 S'))
///
/// with S the covariance before, S' after, A_I and A_3 the means of P^T P over image and workspace, weighted
/// by how uncertain each place is before: I-optimality that leans towards the worst (G). The weights w are
/// one, and a tenth where the goal is met. The error of the arm at the stop, shared by all streams, is part
/// of it. To rank stops, four corners with about the second moments of them all stand for all of them.
///
/// Source: Atkinson, Donev, "Optimum Experimental Designs", 1992 (I-, or V-optimality); greedy choice as in
/// Rojtberg, Kuijper, "Efficient Pose Selection for Interactive Camera Calibration", 2018.
class Forecast {
 public:
  /// @throws std::invalid_argument if the solution's covariance is not finite, or has systematic errors of
  /// the arm in
  ///   it: how they act at a stop that has not been made depends on joint angles that nobody knows yet.
  Forecast(const BoardSpec& board, const JointSolution& solution, const ForecastOptions& options);

  /// Of each stop, on its own. A look at which a corner would not project counts as none.
  [[nodiscard]] std::vector<double> gains(const std::vector<PlannedStop>& stops) const;
  /// Takes the stop for made.
  void add(const PlannedStop& stop);

  /// The solution with the covariance that is left; the rest of it is what it was.
  const JointSolution& solution() const { return solution_; }

 private:
  struct Rows;
  /// What shall become certain.
  struct Target {
    std::size_t camera = 0;
    Eigen::MatrixXd root;  // R with R^T R = A_I or A_3, over that camera's intrinsics and pose
    double weight = 1.0;
  };
  /// A target at the present covariance, in few columns of aims_by_shared_.
  struct Aim {
    Eigen::Index columns = 0;
    double variance = 0.0;
    double weight = 1.0;
  };

  void setAims();
  std::vector<Rows> rowsOf(const std::vector<PlannedStop>& stops, const std::vector<int>& corner_ids) const;

  BoardSpec board_;
  JointSolution solution_;
  std::vector<Target> targets_;
  std::vector<Aim> aims_;           // One per target.
  Eigen::MatrixXd aims_by_shared_;  // Covariance of the shared parameters with what counts, aim beside aim.
};

}  // namespace servocal::calib
