// SPDX-License-Identifier: GPL-3.0-or-later
// Parts of a result file that occur in several of its sections; docs/result-schema.md.
#pragma once

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include "result_keys.h"
#include "servocal/core/result.h"

namespace servocal::session {

using Json = nlohmann::ordered_json;

Json list(const Eigen::VectorXd& values);
Json matrix(const Eigen::MatrixXd& values);  ///< Rows.

/// The model and, if there are some, the standard deviations of its parameters.
Json cameraModelTree(const CameraModel& camera, const Eigen::VectorXd& sigma);
Json poseTree(const PoseNames& names, const Eigen::Isometry3d& pose,
              const Eigen::Matrix<double, 6, 1>& sigma);

/// The section `joint`. Its cameras are all on one mount.
Json jointTree(const JointResult& joint);

}  // namespace servocal::session
