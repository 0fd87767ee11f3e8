// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <vector>

namespace servocal::calib {

/// The rigid motion that takes `from` to `to` (as many, at least one) with the least squares.
/// Source: Arun, Huang, Blostein, PAMI 9(5), 1987; reflections as in Umeyama, PAMI 13(4), 1991.
Eigen::Isometry3d rigidFit(const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to);

/// Mean of points.
Eigen::Vector3d meanOf(const std::vector<Eigen::Vector3d>& points);

}  // namespace servocal::calib
