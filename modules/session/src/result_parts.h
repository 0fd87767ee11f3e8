// SPDX-License-Identifier: GPL-3.0-or-later
// Reading the parts of a result file that occur in several of its sections. All of it throws as ConfigReader.
#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "result_keys.h"
#include "servocal/core/config_reader.h"
#include "servocal/core/result.h"

namespace servocal::session {

/// A number that is not finite is null in the file; what it was is not kept.
inline const Range kNumber{Range{}.min, Range{}.max, /*null_is_nan=*/true};
inline constexpr Range kCount{0, 2147483647};

/// Radians that saveResult writes as these degrees: the quotient, or a neighbor of it.
double radians(double deg);

/// Of any size if `size` is 0.
Eigen::VectorXd vectorOf(const ConfigReader& tree, const char* key, std::size_t size = 0);

struct ReadModel {
  CameraModel camera;
  Eigen::VectorXd sigma;
};
/// Leaves the tree open: the caller knows more keys and finishes it.
ReadModel readModel(const ConfigReader& tree, bool with_sigma);

struct ReadPose {
  Eigen::Isometry3d pose;
  Eigen::Matrix<double, 6, 1> sigma;
};
ReadPose readPose(const ConfigReader& tree, const PoseNames& names);

/// The section `joint`; `mount` where it does not say it.
JointResult readJoint(const ConfigReader& tree, Mount mount);

}  // namespace servocal::session
