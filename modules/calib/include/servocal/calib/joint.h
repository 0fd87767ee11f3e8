// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "servocal/calib/hand_eye.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::calib {

/// One image stream to be calibrated: the color or the infrared side of a camera.
struct JointStream {
  std::string camera;
  Stream stream = Stream::kColor;
  LensModel lens = LensModel::kPlumbBob;
  std::vector<std::string> fixed;        ///< Intrinsics held at their start (0 for distortion), by name.
  std::optional<IntrinsicsPrior> prior;  ///< In the cost; for live estimates from few views.
};

/// What the board may differ in from its description: a print is scaled, a plate is bowed.
///
///   X_o = (scale_x X, scale_y Y, bow_x (1 - (X / x_max)^2) + bow_y (1 - (Y / y_max)^2)).
struct BoardShape {
  double scale_x = 1.0;
  double scale_y = 1.0;
  double bow_x_m = 0.0;  ///< Height of the middle over the ends of the rows, along the board's z, m.
  double bow_y_m = 0.0;  ///< Likewise of the columns.
};

/// Which of them are estimated, and how far they are expected off: a Gaussian prior.
struct BoardFreedom {
  bool scale = true;
  bool bow = true;
  double scale_sigma = 0.02;
  double bow_sigma_m = 0.001;
};

/// Systematic errors of the arm (joint offsets, link lengths), with priors. The module knows no kinematics:
/// it is told how each of them moves the flange.
struct RobotTerms {
  std::vector<std::string> names;  ///< "joint 2 offset (rad)", ...
  Eigen::VectorXd prior_sigma;     ///< Of each, in its own unit; the prior mean is zero. Their common scale is a variance
                                   ///< component, for which these count as six degrees of freedom.
  /// 6 x names.size(): displacement (m) of the flange's origin, then its turn (rad), both along the flange's
  /// own axes, per unit of each term, at this state: true bMe = reported bMe * [turn, displacement].
  std::function<Eigen::MatrixXd(const RobotState&)> jacobian;
};

struct JointOptions {
  Mount mount = Mount::kFixed;       ///< Of all cameras: they stand, or they ride on the flange.
  std::vector<JointStream> streams;  ///< Empty: every color and infrared stream in the observations.
  BoardFreedom board;
  std::optional<RobotTerms> robot_terms;
  double robot_sigma_m = 0.0003;    ///< Declared robot noise per axis and stop: accuracy over the volume,
  double robot_sigma_rad = 0.0005;  ///< not repeatability. The start of the estimate, or what is believed
  bool estimate_noise = true;       ///< if this is false (then corners are believed as claimed too).
  double huber_sigma = 2.5;         ///< Robust loss per corner starts here, in standard deviations.
  double undetermined_share = 0.3;  ///< A direction whose standard deviation exceeds this share of what is
                                    ///< known beforehand counts as not determined.
  HandEyeOptions closed_form;       ///< When to refuse.
};

enum class JointStatus {
  kSolved,
  kTooFewViews,
  kRotationAxesParallel,  ///< The robot turned about one axis only.
  kNotDetermined,         ///< Data leave a camera's pose, a focal length or the board's pose open.
  kInconsistent,          ///< Robot and images contradict each other.
  kNotConverged,
};
/// Sentence for the operator: what happened, and what to do about it.
const char* toString(JointStatus status);

/// One stream's part of the solution.
struct JointCamera {
  std::string camera;
  Stream stream = Stream::kColor;
  CameraModel model;
  Eigen::Isometry3d pose;                ///< Of this stream's camera frame. kFixed: bMc. kFlange: eMc.
  int intrinsics_at = 0;                 ///< First of its free intrinsics in JointSolution::names,
  int pose_at = 0;                       ///< and first of the six of its pose.
  std::vector<int> free;                 ///< Which of model.parameters were estimated, in that order.
  std::optional<IntrinsicsPrior> prior;  ///< As given.
  double corner_scale = 1.0;             ///< Corner noise over what the detector claims; estimated.
  double chi_square = 0.0;  ///< Per degree of freedom, by the claimed covariances: corner_scale squared
                            ///< unless estimate_noise is false.
  double rms_px = 0.0;      ///< With each stop's pose corrected. Fit, not accuracy.
  std::vector<ViewResidual> views;
};

/// How far the arm was off at one stop, as far as the cameras can tell.
struct StopCorrection {
  std::int64_t observation_id = 0;
  Eigen::Matrix<double, 6, 1> correction;  ///< Displacement (m) and turn (rad) of the flange, along its axes.
  Eigen::Matrix<double, 6, 1> sigma;
};

/// Robot noise: declared, and as the cameras see it.
struct RobotNoise {
  double sigma_m = 0.0;  ///< Per axis and stop; used in the cost.
  double sigma_rad = 0.0;
  double declared_m = 0.0;
  double declared_rad = 0.0;
  double degrees_m = 0.0;  ///< Degrees of freedom that the estimate rests on; 0: not estimated.
  double degrees_rad = 0.0;
};

/// A combination of parameters that the data leave open.
struct OpenDirection {
  double sigma = 0.0;         ///< In units of what is known beforehand; infinite if nothing speaks of it.
  Eigen::VectorXd direction;  ///< Over JointSolution::names, in those units, length one.
  std::string sentence;       ///< What is open, and what to do.
};

struct JointSolution {
  Mount mount = Mount::kFixed;
  std::vector<JointCamera> cameras;  ///< By camera name, then stream.
  Eigen::Isometry3d board_pose;      ///< kFixed: eMo. kFlange: bMo.
  BoardShape board;
  Eigen::VectorXd robot_terms;  ///< In the order of RobotTerms::names.
  RobotNoise robot;
  std::vector<StopCorrection> stops;  ///< Of the stops in use, by observation id.

  /// The shared parameters: per camera "cam color fx", ..., "cam color x", "y", "z", "turn x", ...; "board
  /// x",
  /// ..., "board turn z"; "board scale x", ...; the robot's. Poses move by a displacement of their origin (m)
  /// and a turn about it (rad), along the axes of the frame they are given in.
  std::vector<std::string> names;
  Eigen::MatrixXd covariance;  ///< Of the shared parameters. NaN in rows that nothing bounds; a parameter
                               ///< that is merely badly known has its large variance here.
  Eigen::VectorXd sigma;       ///< NaN where the data say too little to report anything; see open.
  std::vector<OpenDirection> open;
  int board_at = 0;  ///< First of the six of board_pose in names,
  int shape_at = 0;  ///< first of the board's shape (scale, bow, those that are free),
  int robot_at = 0;  ///< first of the robot's terms.
  BoardFreedom board_freedom;
  std::optional<RobotTerms> robot_model;  ///< As given, the priors scaled as estimated.
  std::vector<std::string> notes;  ///< What a person should know, a sentence each.
};

struct JointOutcome {
  JointStatus status = JointStatus::kTooFewViews;
  double axis_spread = 0.0;               ///< As HandEyeResult::axis_spread.
  std::vector<OpenDirection> open;        ///< Why, if kNotDetermined.
  std::optional<JointSolution> solution;  ///< Present only if kSolved.
};

/// Everything at once, by maximum likelihood: intrinsics and pose of every stream, the mount, the board's
/// shape, systematic robot errors, and one robot error per stop that all cameras share:
///
///   sum over stops i, streams k, corners j of huber(|W_ikj (project_k(cMb bMe_i C_i eMo B(X_j)) - z_ikj)| /
///   s_k)
///     + sum over i of |c_i|^2 / sigma_m^2 + |w_i|^2 / sigma_rad^2 + priors
///
/// C_i = [exp(w_i + ...), c_i + ...] displaces and turns the flange of stop i, robot terms included; for
/// cameras on the flange the chain is cMe C_i^-1 eMb_i bMo B(X_j). Corner noise s_k of each stream and robot
/// noise are variance components, estimated from the residuals with their degrees of freedom. Starts from
/// solveIntrinsics and solveHandEyeReprojection; views that stand out are left out with the cause.
///
/// The robot's motion gives the images a metric: with a small board the focal length comes out an order of
/// magnitude better than from images alone, if the robot is as good as its sigma says.
///
/// Deterministic, and independent of the order of the observations (their ids decide it).
///
/// Sources: variance components after Förstner, "Ein Verfahren zur Schätzung von Varianz- und
/// Kovarianzkomponenten", 1979; bowed board after mrcal ("calobject_warp"); Huber 1964.
///
/// @throws std::invalid_argument if a sigma is not positive, a corner id is not the board's, a robot pose is
/// not
///   finite, or a stream, its fixed names or its prior do not fit its views.
[[nodiscard]] JointOutcome solveJoint(const BoardSpec& board, const std::vector<Observation>& observations,
                                      const JointOptions& options = {});

}  // namespace servocal::calib
