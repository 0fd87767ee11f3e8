// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"

namespace servocal {

/// A grid over an image, row by row from the upper left, borders included.
struct ProjectionMap {
  int cells_x = 0;
  int cells_y = 0;
  std::vector<double> sigma_px;  ///< Standard deviation of the projection in its worst direction.
  double worst_px = 0.0;
  double rms_px = 0.0;
};

/// A grid over a box in the frame that the camera stands in, x fastest, then y, borders included.
struct WorkspaceMap {
  int cells_x = 0;
  int cells_y = 0;
  int cells_z = 0;
  std::vector<double>
      sigma_m;           ///< Length of the standard deviation of a 3-D point; NaN where it is not seen.
  double worst_m = 0.0;  ///< Of those seen.
  double rms_m = 0.0;
  int seen = 0;
};

/// The estimate from every other stop against that from the rest: what two independent halves say of the same pixel
/// at the range of the views, over the image.
struct JointHalves {
  double rms_px = 0.0;      ///< Of the difference,
  double claimed_px = 0.0;  ///< and what both claims together say it should be.
};

/// One stream's part of the joint estimate, and how far to believe it.
struct JointCameraResult {
  std::string camera;
  Stream stream = Stream::kColor;
  CameraModel model;
  Eigen::VectorXd sigma;   ///< Of model.parameters; 0 where held fixed, NaN where open.
  Eigen::Isometry3d pose;  ///< Of this stream's frame: bMc of a fixed camera, eMc on the flange.
  Eigen::Matrix<double, 6, 6> pose_covariance;  ///< Of its origin (m), then of a turn about it (rad), along
                                                ///< the axes of the frame that the pose is given in.
  double rms_px = 0.0;        ///< With each stop's pose corrected. Fit, not accuracy.
  double corner_scale = 1.0;  ///< Corner noise over what the detector claims, as estimated.
  int views = 0;              ///< Used ones.
  ProjectionMap at_infinity;  ///< Of the projection of a point that stands in the base (or on
  ProjectionMap at_range;     ///< the flange): far away, and at the range of the views.
  double range_m = 0.0;       ///< That range: median distance of the board.
  WorkspaceMap workspace;     ///< Of points measured in this camera and mapped to the base.
  std::optional<JointHalves> halves;  ///< Nothing if either half of the stops is too few.
};

/// Where one stream's camera stands beside another's. What both poses have wrong alike is in neither number.
struct JointPair {
  std::string first;
  Stream first_stream = Stream::kColor;
  std::string second;
  Stream second_stream = Stream::kColor;
  Eigen::Isometry3d first_by_second;  ///< Pose of the second in the first: takes points of the second to the first, m.
  Eigen::Matrix<double, 6, 6> covariance;  ///< Of its origin (m), then of a turn about it (rad), along the axes of the
                                           ///< first.
  double worst_m = 0.0;  ///< How far apart both have a point of the workspace that both see, lenses included: length of
  double rms_m = 0.0;    ///< the standard deviation, at the worst place and over all of them.
  int seen = 0;          ///< Places that both see.
};

/// Prediction of views that no solver saw, the robot believed, against what was claimed.
struct JointHeldOut {
  int views = 0;
  double rms_px = 0.0;
  double rms_m = 0.0;
  double z =
      0.0;  ///< Root of chi-square per degree of freedom: 1 if the claims hold, more if they are too small.
};

/// The joint maximum-likelihood estimate of a whole cell: calib::solveJoint and what follows from it.
struct JointResult {
  Mount mount = Mount::kFixed;              ///< Of all cameras.
  std::vector<JointCameraResult> cameras;   ///< By camera name, then stream.
  std::vector<JointPair> pairs;             ///< Color and infrared of each camera, and the color streams of every two.
  Eigen::Isometry3d board_pose;             ///< eMo; bMo if the cameras are on the flange.
  Eigen::Matrix<double, 6, 1> board_sigma;  ///< Of its origin (m), then of a turn about it (rad).
  double board_scale_x = 1.0;               ///< Print over its description.
  double board_scale_y = 1.0;
  double board_bow_x_m = 0.0;  ///< Height of the middle over the ends.
  double board_bow_y_m = 0.0;
  double robot_sigma_m = 0.0;  ///< Robot noise per axis and stop, as estimated,
  double robot_sigma_rad = 0.0;
  double declared_sigma_m = 0.0;  ///< and as declared in the cell file.
  double declared_sigma_rad = 0.0;
  std::vector<std::pair<std::string, double>> robot_terms;  ///< Systematic errors of the arm, by name; empty
                                                            ///< if the data do not support them.
  std::string model;                ///< Which description of the cell was chosen, and what the data do
                                    ///< not support; a sentence.
  std::vector<std::string> open;    ///< What the data leave open, and what to do; a sentence each.
  std::vector<std::string> faults;  ///< Who is to blame for what does not fit; a sentence each.
  std::vector<std::string> notes;   ///< What else a person should know, a sentence each.
  std::optional<JointHeldOut> held_out;

  /// Nothing if the joint estimate does not have that stream.
  const JointCameraResult* find(const std::string& camera, Stream stream) const;
};

}  // namespace servocal
