// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

namespace servocal::board {

/// Homography that takes `from` to `to` (at least four points), by least squares in `to`'s units. `from` should
/// be of the order of one.
Eigen::Matrix3d fitHomography(const std::vector<Eigen::Vector2d>& from, const std::vector<Eigen::Vector2d>& to);

/// Smooth map from grid coordinates (u along rows, v along columns, in squares) to pixels: a homography
/// for the plane's perspective and a low-order polynomial for what a lens adds to it.
class Warp {
 public:
  /// Least squares over a grid of `columns` x `rows` corners, of which `grid` and `pixels` (as many) are
  /// known. The polynomial's order follows the size of the grid.
  /// @throws std::invalid_argument for fewer than 4 points.
  Warp(int columns, int rows, const std::vector<Eigen::Vector2d>& grid,
       const std::vector<Eigen::Vector2d>& pixels);

  Eigen::Vector2d at(const Eigen::Vector2d& grid) const;
  /// Pixels per square: first column along u, second along v.
  Eigen::Matrix2d jacobian(const Eigen::Vector2d& grid) const;
  /// Curvature of the lines along u and along v, towards growing v and growing u, 1/px. What perspective does
  /// leaves lines straight.
  Eigen::Vector2d bend(const Eigen::Vector2d& grid) const;
  bool isFinite() const;
  /// Length of the largest polynomial part over the corners, px: how far from a plain plane this is.
  double largestBend() const { return largest_bend_; }

 private:
  Eigen::VectorXd basis(const Eigen::Vector2d& normalized) const;
  Eigen::Vector2d normalize(const Eigen::Vector2d& grid) const { return (grid - centre_) / scale_; }

  Eigen::Vector2d centre_;
  double scale_ = 1.0;
  Eigen::Matrix3d homography_;  ///< From normalized grid to pixels.
  int terms_ = 0;               ///< 0, 6 (quadratic) or 10 (cubic).
  Eigen::Matrix<double, Eigen::Dynamic, 2> coefficients_;
  double largest_bend_ = 0.0;
};

}  // namespace servocal::board
