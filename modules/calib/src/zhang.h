// SPDX-License-Identifier: GPL-3.0-or-later
// Closed-form start of the intrinsics.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/observation.h"

namespace servocal::calib {

/// Homography from the board's plane (m) to the image (px), by the normalized direct linear transform.
/// Nothing if the corners do not determine it.
std::optional<Eigen::Matrix3d> boardHomography(const BoardSpec& board, const BoardDetection& detection);

/// Focal length (px) of a camera with square pixels and a known principal point: least squares over the
/// two constraints that every homography puts on the image of the absolute conic. The principal point is
/// taken as known because with lens distortion the full closed form is often worse than the image centre.
/// Nothing if the views do not determine it.
///
/// Source: Z. Zhang, "A Flexible New Technique for Camera Calibration", 2000, equations 3 and 4.
std::optional<double> focalFromHomographies(const std::vector<Eigen::Matrix3d>& homographies,
                                            const Eigen::Vector2d& principal_point_px);

}  // namespace servocal::calib
