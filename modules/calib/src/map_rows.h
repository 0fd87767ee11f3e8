// SPDX-License-Identifier: GPL-3.0-or-later
// How a camera's free intrinsics and its pose move what it shows and what it measures: what every map of
// uncertainty is made of. Columns: free intrinsics, displacement of the camera's origin (m), turn about it
// (rad), along the axes of the frame that the pose is given in.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "servocal/calib/joint.h"

namespace servocal::calib {

/// A point of the camera frame with the derivatives that every map is made of.
struct Seen {
  ProjectionJacobian by;
  Eigen::Vector3d point_c;
};

std::optional<Seen> seenAt(const JointCamera& camera, const Eigen::Vector3d& point_c);

/// The pixel's columns for the free intrinsics.
Eigen::MatrixXd byIntrinsics(const JointCamera& camera, const ProjectionJacobian& by);

/// The pixel of a fixed point, by the camera's pose: displacement, turn, along the axes of the left frame. A
/// point at infinity does not feel the displacement; its `point_c` is a direction of length one in z.
Eigen::Matrix<double, 2, 6> byPose(const JointCamera& camera, const Seen& seen, bool at_infinity);

/// Rays of a grid over the image, at this depth; those that the model cannot unproject are nothing.
std::vector<std::optional<Seen>> grid(const JointCamera& camera, int cells_x, int cells_y, double depth_m);

/// Where a pixel with its depth held comes to lie in the frame the camera stands in, by intrinsics and pose.
/// Nothing if the camera does not show the point.
std::optional<Eigen::MatrixXd> byBackProjection(const JointCamera& camera, const Eigen::Vector3d& point_l);

}  // namespace servocal::calib
