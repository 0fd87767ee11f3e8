// SPDX-License-Identifier: GPL-3.0-or-later
// Where the board's plane is at the patches of a depth image, and how well that is known.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "servocal/calib/depth_distortion.h"

namespace servocal::calib {

/// One view's patches beside the board's plane.
struct DepthView {
  std::int64_t id = 0;
  std::vector<Eigen::Vector2d> pixels;
  Eigen::VectorXd stretch;     ///< sqrt(1 + x^2 + y^2): range over depth.
  Eigen::VectorXd raw_m;       ///< Measured depth,
  Eigen::VectorXd raw_sigma_m; ///< and its standard deviation.
  Eigen::VectorXd plane_m;     ///< Depth of the board's plane there.
  Eigen::MatrixXd plane_covariance_m2;
};

/// Nothing if the board's pose is not determined, or a patch's ray misses the plane.
std::optional<DepthView> depthView(const BoardSpec& board, const CameraModel& infrared,
                                   const Observation& observation, const StreamObservation& seen,
                                   const DepthOptions& options);

}  // namespace servocal::calib
