// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/depth_model.h"
#include "servocal/core/joint_result.h"
#include "servocal/core/pose.h"

namespace servocal {

/// Why a view is not part of a solution.
enum class ViewCause {
  kNone,      ///< It is part of it.
  kNoBoard,   ///< No board was found, or too little of it.
  kCorners,   ///< Its corners are not those of this board in this camera: wrong board, wrong detection.
  kBlurred,   ///< Its corners are far less sharp than those of the other views, and fit worse.
  kRobotPose, ///< Its robot pose contradicts the image.
  kPoseFlip,  ///< Its robot pose goes with the mirrored one of the two poses that a plane has.
};
const char* toString(ViewCause cause);  ///< "none", "no_board", "corners", "blurred", "robot_pose", "pose_flip"

/// How one view fits the solution.
struct ViewResidual {
  std::int64_t observation_id = 0;
  std::string name;        ///< Image file or stage.
  double rms_px = 0.0;     ///< Over the view's corners, length of the 2-vector.
  bool used = true;
  std::string reason;      ///< Why it was not used, a sentence; empty if it was.
  ViewCause cause = ViewCause::kNone;  ///< The same in a word.
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
  int symmetric_views = 0;  ///< Used views whose image does not tell the board's turn about its normal; the
                            ///< robot's motion did. If it is all of them, one turn common to all, and with
                            ///< it that of board_pose, stays undetermined.
  int resolved_turns = 0;   ///< Of those, views whose corner numbers had to be turned to go with the rest.
  int resolved_flips = 0;   ///< Used views where the robot decided against the better fitting one of the two
                            ///< poses that a plane has.
  std::vector<ViewResidual> views;
};

/// Size of the board's pattern by the robot's motion.
struct BoardScale {
  double scale = 1.0;       ///< True size over stated size, as far as the robot's lengths are true.
  double sigma = 0.0;       ///< Standard deviation.
};

/// Depth correction of one camera and how well it is known.
struct DepthResult {
  DepthModel model;
  double rms_before_m = 0.0;   ///< Patches against the plane that the board's corners give, uncorrected,
  double rms_after_m = 0.0;    ///< and corrected. Fit, not accuracy.
  Eigen::VectorXd sigma_m;     ///< Standard deviation of the correction in the middle of the image, m, at
  Eigen::VectorXd sigma_at_m;  ///< these ranges (m): the ends and the middle of those visited, and 1.5 m.
  int views = 0;
  int patches = 0;
  std::vector<std::string> notes;  ///< What was left out of the model and why, a sentence each.
};

/// The paper's estimator, as a baseline: an affine map (3 x 4, RANSAC) from board positions measured in the
/// camera (corner depths) to those the robot says. Not a pose: it is not rigid.
struct AffineEyeToHand {
  Eigen::Matrix<double, 3, 4> bAc;  ///< Takes points (m) in c to b.
  double rms_m = 0.0;               ///< Over the inliers, length of the 3-vector.
  int inliers = 0;
  int points = 0;
};

struct TiltLimit {
  std::string direction;      ///< "roll+", "roll-", "pitch+", ...
  double limit_rad = 0.0;     ///< Largest angle at which the board was still detected.
  std::string ended_by;       ///< "detection", "cap", "reach".
  Stream stream = Stream::kColor;
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
  std::vector<std::string> out_of_reach;  ///< Distances and tilts given up after tries: "far views", "tilt yaw-".
};

/// Where one camera stands beside another: a stereo rig, or color and infrared of one RGB-D camera.
struct CameraPair {
  std::string first;
  std::string second;
  Eigen::Isometry3d first_by_second;  ///< Pose of the second camera in the first: takes points of the second
                                      ///< to the first, m.
  Eigen::Matrix<double, 6, 6> covariance;  ///< Of its origin (m), then of a turn about that origin (rad), along
                                      ///< the axes of the first camera.
  double rms_px = 0.0;                ///< Of both cameras' residuals together. Fit, not accuracy.
  std::vector<ViewResidual> views;    ///< Of the observations in which both see the board.
};

/// Error in views that no solver saw: where result and robot predict the corners against where they are seen.
/// The robot's error is in it.
struct HeldOut {
  int views = 0;
  double rms_px = 0.0;
  double rms_m = 0.0;  ///< Against the corners by the board's pose in the image.
};

/// Everything about one camera.
struct CameraResult {
  std::string camera;
  IntrinsicsResult intrinsics;
  std::optional<HandEyeSolution> hand_eye;
  std::optional<IntrinsicsResult> intrinsics_with_outliers;  ///< Present only if views were left out: the
  std::optional<HandEyeSolution> hand_eye_with_outliers;     ///< same solved with them, for comparison.
  std::optional<BoardScale> board_scale;  ///< Present if there are robot poses that determine it.
  std::vector<std::string> notes;         ///< What else a person should know, a sentence each.
  std::optional<CoverageSummary> coverage;
  std::vector<TiltLimit> tilt_limits;

  std::optional<IntrinsicsResult> infrared;           ///< This and below: of an RGB-D camera.
  std::optional<HandEyeSolution> infrared_hand_eye;   ///< The infrared camera by itself, for comparison.
  std::optional<CameraPair> color_infrared;           ///< cMi: first is the color stream, second the infrared.
  std::optional<DepthResult> depth;
  std::optional<CoverageSummary> infrared_coverage;
  int combined_views = 0;             ///< Observations in which color and infrared both saw the board.
  std::optional<AffineEyeToHand> affine_baseline;
  std::optional<double> time_offset_s;  ///< Image stamps minus robot stamps, estimated while the board moved.
  double time_offset_sigma_s = 0.0;
  std::optional<HeldOut> held_out;
};

/// What a run ends with; see docs/result-schema.md.
struct CalibrationResult {
  int schema_version = 3;
  bool goal_met = false;
  std::vector<std::string> missing;  ///< What the goal lacks, a sentence each; empty if goal_met.
  BoardSpec board;
  std::vector<CameraResult> cameras;
  std::vector<CameraPair> camera_pairs;  ///< The first camera with each of the others that see the board with it.
  std::optional<JointResult> joint;  ///< Everything at once; nothing if that could not be solved, which
                                     ///< joint_problem then says.
  std::string joint_problem;
  double motion_time_s = 0.0;        ///< First to last motion, tilt search included.
  double tilt_time_s = 0.0;          ///< Of which tilt search.
  int observations = 0;
  std::string provenance;            ///< Program version, seed, session.
};

}  // namespace servocal
