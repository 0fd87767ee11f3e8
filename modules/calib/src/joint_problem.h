// SPDX-License-Identifier: GPL-3.0-or-later
// The joint least-squares problem: parameters, their layout, residuals with derivatives.
//
// Built on arrow.h and not on Ceres: the six numbers of each stop are eliminated there by the same Schur
// complement whose inverse is the covariance, and the variance components need the blocks of that inverse at
// every round. Measured side by side in docs/joint.md.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "arrow.h"
#include "board_turns.h"
#include "servocal/calib/joint.h"

namespace servocal::calib {

/// Standard deviations of the noise: two variance components of the robot, one per stream, and one of the robot's terms.
struct JointNoise {
  double robot_m = 0.0;
  double robot_rad = 0.0;
  std::vector<double> corner_scale;  // by stream
  double terms_scale = 1.0;          // of the priors of the robot's terms
};

struct JointState {
  struct Camera {
    CameraModel model;
    Eigen::Isometry3d lMc;  // l: frame the camera stands in (fixed: base, flange: end effector)
  };
  std::vector<Camera> cameras;
  Eigen::Isometry3d rMo;  // r: frame that holds the board (fixed: end effector, flange: base)
  BoardShape shape;
  Eigen::VectorXd terms;  // systematic robot errors
  std::vector<Vector6d>
      corrections;  // by stop; of the flange: displacement (m), rotation vector (rad), its axes
};

/// One image of one stop.
struct JointView {
  std::size_t stop = 0;
  std::size_t camera = 0;
  const BoardDetection* detection = nullptr;
  int turn = 0;                          // the corner ids are read as those of this turn of the board
  std::vector<Eigen::Matrix2d> weights;  // whitening, by corner
};

struct JointStop {
  const Observation* observation = nullptr;
  Eigen::Isometry3d bMe;
  Eigen::MatrixXd by_terms;  // 6 x terms
};

/// Where which parameter stands among the shared ones.
struct JointLayout {
  struct Camera {
    std::vector<int> free;  // of the model's parameters
    int at = 0;             // intrinsics, then the six of the pose
    int poseAt() const { return at + static_cast<int>(free.size()); }
    int size() const { return static_cast<int>(free.size()) + 6; }
  };
  std::vector<Camera> cameras;
  int board_at = 0;
  int shape_at = 0;
  bool scale = true;
  bool bow = true;
  int terms_at = 0;
  int size = 0;
  int shapeSize() const { return (scale ? 2 : 0) + (bow ? 2 : 0); }
};

/// One view's residuals. The columns of the Jacobian are those of its camera, of the board's pose and shape,
/// and of its stop's correction.
struct JointResidual {
  Eigen::MatrixXd jacobian;
  Eigen::VectorXd residual;
  double robust_excess = 0.0;  // robust cost minus the weighted squares that stand for it
};

class JointProblem {
 public:
  JointProblem(const BoardSpec& board, const JointOptions& options, std::vector<JointStop> stops);

  void setStops(std::vector<JointStop> stops) { stops_ = std::move(stops); }
  void setViews(std::vector<JointView> views) { views_ = std::move(views); }
  void setNoise(const JointNoise& noise) { noise_ = noise; }
  const std::vector<JointView>& views() const { return views_; }
  const std::vector<JointStop>& stops() const { return stops_; }
  const JointNoise& noise() const { return noise_; }
  const JointLayout& layout() const { return layout_; }
  const JointOptions& options() const { return options_; }
  const BoardTurns& turns() const { return turns_; }
  bool knows(int corner_id) const { return corner_id >= 0 && corner_id < static_cast<int>(points_o_.size()); }

  /// What is known of each shared parameter beforehand, as a standard deviation: the unit in which directions
  /// are judged. Data sheet for intrinsics, 0.1 m and 0.2 rad for poses, the priors for the rest.
  Eigen::VectorXd scales(const JointState& state) const;
  std::vector<std::string> names() const;

  /// Nothing if a corner cannot be projected.
  std::optional<JointResidual> residual(const JointState& state, const JointView& view) const;
  /// Priors included, and an anchor: a thousandth of the information of scales() on the diagonal, which keeps
  /// the matrix regular and moves no solution.
  std::optional<ArrowSystem> linearize(const JointState& state) const;
  /// What one stop contributes, its robot noise included, the priors of shared parameters not: one block.
  std::optional<ArrowSystem> linearizeStop(const JointState& state, std::size_t stop) const;
  JointState move(const JointState& state, const ArrowStep& step) const;

  /// cMo as the state has it, with the stop's correction.
  Eigen::Isometry3d boardPose(const JointState& state, const JointView& view,
                              const Vector6d& correction) const;
  /// Corner `id` read with `turn`, of the board as the state has it.
  Eigen::Vector3d point(const JointState& state, int id, int turn) const;
  /// The correction of a stop, systematic part included.
  Vector6d correction(const JointState& state, std::size_t stop) const;

 private:
  /// False if a corner cannot be projected.
  bool addView(const JointState& state, const JointView& view, std::size_t block, ArrowSystem& system) const;
  void finishStop(const JointState& state, std::size_t stop, std::size_t block, ArrowSystem& system) const;
  void addPriors(const JointState& state, ArrowSystem& system) const;

  const JointOptions& options_;
  std::vector<Eigen::Vector3d> points_o_;
  Eigen::Vector2d half_size_m_;
  BoardTurns turns_;
  std::vector<JointStop> stops_;
  std::vector<JointView> views_;
  JointLayout layout_;
  JointNoise noise_;
};

}  // namespace servocal::calib
