// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/depth_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::calib {

/// The board's centre at one stop, by the depth image and by the robot.
struct BoardPoint {
  std::int64_t observation_id = 0;
  Eigen::Vector3d in_camera;  ///< In the infrared camera, m: mean over the corners with depth.
  Eigen::Vector3d in_base;    ///< Mean of the same corners by robot and eMo, m.
};

/// Points from the infrared views of a camera that carry corner depths (at least four corners), in
/// observations with a robot pose. `eMo`: the paper takes the board's centre as the flange's.
/// @throws std::invalid_argument if a corner id is not the board's.
std::vector<BoardPoint> boardPoints(const BoardSpec& board, const DepthModel& depth,
                                    const std::vector<Observation>& observations, const std::string& camera,
                                    const Pose<EndEffector, Board>& eMo);

struct EyeToHandOptions {
  double inlier_m = 0.015;  ///< RANSAC: points nearer than this to the model agree.
  int draws = 300;
  std::uint64_t seed = 1;
  double min_thickness =
      0.03;  ///< Least over greatest extent of the points, below which they count as a plane.
};

enum class EyeToHandStatus { kSolved, kTooFewPoints, kPointsFlat, kNoConsensus };
/// Sentence for the operator: what happened, and what to do about it.
const char* toString(EyeToHandStatus status);

struct AffineOutcome {
  EyeToHandStatus status = EyeToHandStatus::kTooFewPoints;
  std::optional<AffineEyeToHand> result;  ///< Present only if kSolved.
};

/// The paper's estimator: the affine map from points in the camera to points in the base, RANSAC, then least
/// squares over the points that agree. A baseline: not rigid, and undetermined when the points lie in a plane
/// (board kept at one distance), which is refused.
///
/// Source: Miseikis, Glette, Elle, Torresen, "Automatic Calibration of a Robot Manipulator and Multi 3D
/// Camera System", 2016.
[[nodiscard]] AffineOutcome solveAffineEyeToHand(const std::vector<BoardPoint>& points,
                                                 const EyeToHandOptions& options = {});

/// Where the infrared camera stands, from the same points.
struct RigidEyeToHand {
  Pose<Base, Infrared> bMi;
  Eigen::Matrix<double, 6, 6> covariance =
      Eigen::Matrix<double, 6, 6>::Zero();  ///< Of its origin (m), then of a turn about that origin (rad),
                                            ///< along the axes of the base.
  double lateral_sigma_m = 0.0;             ///< Scatter of a point across the optical axis, per axis,
  double depth_sigma_m = 0.0;  ///< and along it: estimated, and what the points are weighted with.
  int inliers = 0;
  int points = 0;
};

struct RigidOutcome {
  EyeToHandStatus status = EyeToHandStatus::kTooFewPoints;
  std::optional<RigidEyeToHand> result;  ///< Present only if kSolved.
};

/// The rigid motion from camera to base, RANSAC, then maximum likelihood with depth weighted apart from what
/// is across the optical axis. Points on a line are refused; a plane is enough.
///
/// Source: start by Arun, Huang, Blostein, PAMI 9(5), 1987.
[[nodiscard]] RigidOutcome solveRigidEyeToHand(const std::vector<BoardPoint>& points,
                                               const EyeToHandOptions& options = {});

}  // namespace servocal::calib
