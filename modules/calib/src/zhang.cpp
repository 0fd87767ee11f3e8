// SPDX-License-Identifier: GPL-3.0-or-later
#include "zhang.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>

namespace servocal::calib {
namespace {

/// Similarity that moves points to mean zero and mean length sqrt(2).
Eigen::Matrix3d normalization(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& point : points) mean += point;
  mean /= static_cast<double>(points.size());
  double length = 0;
  for (const Eigen::Vector2d& point : points) length += (point - mean).norm();
  const double scale = length > 0 ? std::sqrt(2.0) * points.size() / length : 1.0;
  Eigen::Matrix3d matrix;
  matrix << scale, 0, -scale * mean.x(), 0, scale, -scale * mean.y(), 0, 0, 1;
  return matrix;
}

}  // namespace

std::optional<Eigen::Matrix3d> boardHomography(const BoardSpec& board, const BoardDetection& detection) {
  if (detection.corners.size() < 4) return std::nullopt;
  std::vector<Eigen::Vector2d> plane, image;
  for (const Corner& corner : detection.corners) {
    plane.push_back(board.corner(corner.id).head<2>());
    image.push_back(corner.pixel);
  }
  const Eigen::Matrix3d to_plane = normalization(plane), to_image = normalization(image);
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (std::size_t i = 0; i < plane.size(); ++i) {
    const Eigen::RowVector3d from = (to_plane * plane[i].homogeneous()).transpose();
    const Eigen::Vector3d to = to_image * image[i].homogeneous();
    Eigen::Matrix<double, 2, 9> rows;
    rows << from, Eigen::RowVector3d::Zero(), -to.x() * from,  //
        Eigen::RowVector3d::Zero(), from, -to.y() * from;
    normal += rows.transpose() * rows;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(normal);
  if (!(eigen.eigenvalues()[1] > 1e-9 * eigen.eigenvalues()[8])) return std::nullopt;
  const Eigen::Matrix<double, 9, 1> h = eigen.eigenvectors().col(0);
  Eigen::Matrix3d normalized;
  normalized << h.segment<3>(0).transpose(), h.segment<3>(3).transpose(), h.segment<3>(6).transpose();
  const Eigen::Matrix3d homography = to_image.inverse() * normalized * to_plane;
  if (!homography.allFinite()) return std::nullopt;
  return homography;
}

std::optional<double> focalFromHomographies(const std::vector<Eigen::Matrix3d>& homographies,
                                            const Eigen::Vector2d& principal_point_px) {
  double pp = 0, pq = 0;
  for (Eigen::Matrix3d h : homographies) {
    h.topRows<2>() -= principal_point_px * h.row(2);
    h /= h.topLeftCorner<2, 2>().norm();
    const Eigen::Vector2d a = h.block<2, 1>(0, 0), b = h.block<2, 1>(0, 1);
    const double p[2] = {a.dot(b), a.squaredNorm() - b.squaredNorm()};
    const double q[2] = {h(2, 0) * h(2, 1), h(2, 0) * h(2, 0) - h(2, 1) * h(2, 1)};
    for (int k = 0; k < 2; ++k) {
      pp += p[k] * p[k];
      pq += p[k] * q[k];
    }
  }
  const double inverse_square = -pq / pp;  // of the focal length
  if (!(inverse_square > 0) || !std::isfinite(inverse_square)) return std::nullopt;
  return 1.0 / std::sqrt(inverse_square);
}

}  // namespace servocal::calib
