// SPDX-License-Identifier: GPL-3.0-or-later
// What one image of a plane says by itself: its homography, and from that the two planar poses.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace servocal::calib {

/// Homography that takes plane points (m) to image points (px, or normalized), by the normalized direct
/// linear transform. Nothing if the points do not determine it (fewer than four, or on a line).
std::optional<Eigen::Matrix3d> homography(const std::vector<Eigen::Vector2d>& plane,
                                          const std::vector<Eigen::Vector2d>& image);

/// Both poses (c from plane) that explain an infinitesimal patch of the plane at the mean of its points,
/// given where the points are seen (normalized coordinates X/Z, Y/Z). Of the two, neither is the better
/// one yet. Empty if there is no homography.
///
/// Source: Collins & Bartoli, "Infinitesimal Plane-Based Pose Estimation", IJCV 109, 2014, section 4 and
/// algorithm 1.
std::vector<Eigen::Isometry3d> planarPoses(const std::vector<Eigen::Vector2d>& plane,
                                           const std::vector<Eigen::Vector2d>& normalized);

/// Focal length (px) of a camera with square pixels and a known principal point: least squares over the
/// two constraints that every homography puts on the image of the absolute conic. The principal point is
/// taken as known because with lens distortion the full closed form is often worse than the image centre.
/// Nothing if the views do not determine it.
///
/// Source: Z. Zhang, "A Flexible New Technique for Camera Calibration", 2000, equations 3 and 4.
std::optional<double> focalFromHomographies(const std::vector<Eigen::Matrix3d>& homographies,
                                            const Eigen::Vector2d& principal_point_px);

}  // namespace servocal::calib
