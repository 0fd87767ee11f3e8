// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "servocal/calib/joint.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/joint_result.h"
#include "servocal/core/result.h"

namespace servocal::calib {

/// The board's corners by id as a solution has them, in o, m.
std::vector<Eigen::Vector3d> shapedCorners(const BoardSpec& board, const BoardShape& shape);

/// The covariance that a joint solve of these observations would claim if parameters and noise were those of
/// `at` (cameras, board_pose, board, robot_terms, robot, corner_scale; the rest is not read). Order as
/// JointSolution::names, poses and units too.
///
/// At the truth this is the Cramer-Rao bound (with the priors of `at` as information), at the estimate the
/// claim, and with planned observations the forecast. Corners count as claimed, times corner_scale; nothing
/// is left out.
///
/// @throws std::invalid_argument if a view's corner does not project at `at`, or as solveJoint.
Eigen::MatrixXd jointCovarianceAt(const BoardSpec& board, const std::vector<Observation>& observations,
                                  const JointSolution& at);

enum class Anchor {
  kBase,        ///< A point that stands in the frame the camera stands in: pose and intrinsics err.
  kIntrinsics,  ///< Intrinsics alone, after the rotation (at a distance: the motion) of the camera that hides
                ///< most of their error.
};

/// How far, one sigma, the projection of a point at this distance along the optical axis is off. Without a
/// distance: at infinity. NaN if something open has a part in it.
///
/// Source: mrcal ("projection uncertainty"); the anchored map is its counterpart where the base fixes the
/// frame.
ProjectionMap projectionMap(const JointSolution& solution, const JointCamera& camera, Anchor anchor,
                            std::optional<double> distance_m = std::nullopt, int cells_x = 13,
                            int cells_y = 9);

/// Error of a point that is measured at its pixel with perfect depth and mapped to the base (or flange) with
/// the solution: what intrinsics and pose do to the points of the workspace.
WorkspaceMap workspaceMap(const JointSolution& solution, const JointCamera& camera, const Box& box,
                          int cells = 6);

/// The same of the difference between what two cameras say of one point; what both have wrong alike drops
/// out.
WorkspaceMap disagreementMap(const JointSolution& solution, const JointCamera& first,
                             const JointCamera& second, const Box& box, int cells = 6);

/// Every other stop against the rest: each half is solved on its own, and what both say of points that stand in the
/// image at the median distance of the board is compared, camera by camera of `solution`. Nothing for a camera that one
/// half does not determine.
///
/// Source: mrcal, "cross-validation".
std::vector<std::optional<JointHalves>> compareHalves(const BoardSpec& board,
                                                      const std::vector<Observation>& observations,
                                                      const JointOptions& options, const JointSolution& solution);

/// Pose of the second camera in the first, with the covariance that the joint solution gives it. Without
/// views.
CameraPair cameraPairOf(const JointSolution& solution, const JointCamera& first, const JointCamera& second);

/// How one view that no solver saw is predicted, the robot believed.
struct HeldOutView {
  std::int64_t observation_id = 0;
  std::string camera;
  Stream stream = Stream::kColor;
  double rms_px = 0.0;      ///< Length of the residual.
  double error_m = 0.0;     ///< RMS distance of the corners as this image alone places them (in the frame the
                            ///< camera stands in) from where the robot does.
  double chi_square = 0.0;  ///< Against corner noise, robot noise and the solution's covariance together.
  int degrees = 0;
  double log_density = 0.0;  ///< Of the residual under that noise (whitened by the claimed corner noise).
};

struct HeldOut {
  std::vector<HeldOutView> views;
  double rms_px = 0.0;
  double rms_m = 0.0;
  double z = 0.0;  ///< Root of chi-square per degree of freedom, all views: 1 if the claims hold.
  std::vector<std::string> notes;  ///< Views that could not be predicted.
};

/// Predicts the views of `observations`, which the solution must not have been made from. Cameras that the
/// solution does not have are skipped.
HeldOut predictHeldOut(const BoardSpec& board, const std::vector<Observation>& observations,
                       const JointSolution& solution);

}  // namespace servocal::calib
