// SPDX-License-Identifier: GPL-3.0-or-later
#include "warp.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace servocal::board {
using Eigen::Vector2d;

// Linear least squares, reweighted so that the residual becomes the one in pixels.
Eigen::Matrix3d fitHomography(const std::vector<Vector2d>& from, const std::vector<Vector2d>& to) {
  Vector2d mean = Vector2d::Zero();
  for (const Vector2d& p : to) mean += p;
  mean /= static_cast<double>(to.size());
  double spread = 0.0;
  for (const Vector2d& p : to) spread += (p - mean).squaredNorm();
  spread = std::sqrt(spread / to.size()) + 1e-12;

  Eigen::Matrix<double, 8, 1> h;
  h << 1, 0, 0, 0, 1, 0, 0, 0;
  for (int iteration = 0; iteration < 3; ++iteration) {
    Eigen::Matrix<double, 8, 8> normal = Eigen::Matrix<double, 8, 8>::Zero();
    Eigen::Matrix<double, 8, 1> right = Eigen::Matrix<double, 8, 1>::Zero();
    for (std::size_t k = 0; k < from.size(); ++k) {
      const double x = from[k].x(), y = from[k].y();
      const Vector2d p = (to[k] - mean) / spread;
      const double depth = iteration == 0 ? 1.0 : h[6] * x + h[7] * y + 1.0;
      const double weight = 1.0 / std::max(depth * depth, 1e-4);
      Eigen::Matrix<double, 8, 1> row;
      row << x, y, 1, 0, 0, 0, -p.x() * x, -p.x() * y;
      normal += weight * row * row.transpose();
      right += weight * p.x() * row;
      row << 0, 0, 0, x, y, 1, -p.y() * x, -p.y() * y;
      normal += weight * row * row.transpose();
      right += weight * p.y() * row;
    }
    h = normal.ldlt().solve(right);
  }
  Eigen::Matrix3d homography;
  homography << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0;
  Eigen::Matrix3d denormalize;
  denormalize << spread, 0, mean.x(), 0, spread, mean.y(), 0, 0, 1;
  return denormalize * homography;
}

Warp::Warp(int columns, int rows, const std::vector<Vector2d>& grid, const std::vector<Vector2d>& pixels) {
  if (grid.size() < 4 || grid.size() != pixels.size()) throw std::invalid_argument("Warp: needs 4 points");
  centre_ = Vector2d(0.5 * (columns - 1), 0.5 * (rows - 1));
  scale_ = 0.5 * std::max(columns - 1, rows - 1);
  std::vector<Vector2d> normalized;
  for (const Vector2d& g : grid) normalized.push_back(normalize(g));
  homography_ = fitHomography(normalized, pixels);

  const int smaller = std::min(columns, rows);
  terms_ = smaller >= 4 ? 10 : smaller == 3 ? 6 : 0;
  if (grid.size() < static_cast<std::size_t>(terms_) + 4) terms_ = 0;
  if (terms_ == 0) return;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(terms_, terms_);
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(terms_, 2);
  for (std::size_t k = 0; k < grid.size(); ++k) {
    const Eigen::VectorXd row = basis(normalized[k]);
    const Eigen::Vector3d p = homography_ * normalized[k].homogeneous();
    normal.noalias() += row * row.transpose();
    right.noalias() += row * (pixels[k] - p.hnormalized()).transpose();
  }
  // A little damping: what the corners do not determine stays small outside them.
  normal.diagonal().array() += 1e-3 * grid.size();
  coefficients_ = normal.ldlt().solve(right);
  for (const Vector2d& n : normalized)
    largest_bend_ = std::max(largest_bend_, (coefficients_.transpose() * basis(n)).norm());
}

Eigen::VectorXd Warp::basis(const Vector2d& n) const {
  const double u = n.x(), v = n.y();
  Eigen::VectorXd row(terms_);
  row.head<6>() << 1, u, v, u * u, u * v, v * v;
  if (terms_ == 10) row.tail<4>() << u * u * u, u * u * v, u * v * v, v * v * v;
  return row;
}

Vector2d Warp::at(const Vector2d& grid) const {
  const Vector2d n = normalize(grid);
  Vector2d p = (homography_ * n.homogeneous()).hnormalized();
  if (terms_ > 0) {
    const double u = n.x(), v = n.y();
    const auto row = [&](int k) { return coefficients_.row(k).transpose(); };
    p += row(0) + u * (row(1) + u * row(3) + v * row(4)) + v * (row(2) + v * row(5));
    if (terms_ == 10) p += u * u * (u * row(6) + v * row(7)) + v * v * (u * row(8) + v * row(9));
  }
  return p;
}

Eigen::Matrix2d Warp::jacobian(const Vector2d& grid) const {
  constexpr double kStep = 0.05;  // squares
  Eigen::Matrix2d jacobian;
  jacobian.col(0) = (at(grid + Vector2d(kStep, 0)) - at(grid - Vector2d(kStep, 0))) / (2 * kStep);
  jacobian.col(1) = (at(grid + Vector2d(0, kStep)) - at(grid - Vector2d(0, kStep))) / (2 * kStep);
  return jacobian;
}

Vector2d Warp::bend(const Vector2d& grid) const {
  constexpr double kStep = 0.5;  // squares
  const Eigen::Matrix2d along = jacobian(grid);
  Vector2d bend;
  for (int axis = 0; axis < 2; ++axis) {
    const Vector2d step = kStep * Vector2d::Unit(axis), t = along.col(axis), other = along.col(1 - axis);
    const Vector2d second = (at(grid + step) - 2.0 * at(grid) + at(grid - step)) / (kStep * kStep);
    Vector2d normal(-t.y(), t.x());
    if (normal.dot(other) < 0.0) normal = -normal;
    bend[axis] = normal.dot(second) / std::pow(t.norm(), 3);
  }
  return bend;
}

bool Warp::isFinite() const { return homography_.allFinite() && (terms_ == 0 || coefficients_.allFinite()); }

}  // namespace servocal::board
