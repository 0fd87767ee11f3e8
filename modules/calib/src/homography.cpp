// SPDX-License-Identifier: GPL-3.0-or-later
#include "homography.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

namespace servocal::calib {
namespace {

Eigen::Vector2d meanOf(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& point : points) mean += point;
  return mean / static_cast<double>(points.size());
}

/// Similarity that moves points to mean zero and mean length sqrt(2).
Eigen::Matrix3d normalization(const std::vector<Eigen::Vector2d>& points) {
  const Eigen::Vector2d mean = meanOf(points);
  double length = 0;
  for (const Eigen::Vector2d& point : points) length += (point - mean).norm();
  const double scale = length > 0 ? std::sqrt(2.0) * static_cast<double>(points.size()) / length : 1.0;
  Eigen::Matrix3d matrix;
  matrix << scale, 0, -scale * mean.x(), 0, scale, -scale * mean.y(), 0, 0, 1;
  return matrix;
}

}  // namespace

std::optional<Eigen::Matrix3d> homography(const std::vector<Eigen::Vector2d>& plane,
                                          const std::vector<Eigen::Vector2d>& image) {
  if (plane.size() < 4 || plane.size() != image.size()) return std::nullopt;
  const Eigen::Matrix3d to_plane = normalization(plane), to_image = normalization(image);
  // The last entry is one: it belongs to the mean of the points, which lies before the camera.
  using Matrix8d = Eigen::Matrix<double, 8, 8>;
  using Vector8d = Eigen::Matrix<double, 8, 1>;
  Matrix8d normal = Matrix8d::Zero();
  Vector8d right = Vector8d::Zero();
  for (std::size_t i = 0; i < plane.size(); ++i) {
    const Eigen::Vector2d from = (to_plane * plane[i].homogeneous()).head<2>();
    const Eigen::Vector2d to = (to_image * image[i].homogeneous()).head<2>();
    Eigen::Matrix<double, 2, 8> rows;
    rows << from.x(), from.y(), 1, 0, 0, 0, -to.x() * from.x(), -to.x() * from.y(),  //
        0, 0, 0, from.x(), from.y(), 1, -to.y() * from.x(), -to.y() * from.y();
    normal.noalias() += rows.transpose() * rows;
    right.noalias() += rows.transpose() * to;
  }
  const Eigen::LDLT<Matrix8d> factored(normal);
  const Vector8d pivots = factored.vectorD();
  if (!(pivots.minCoeff() > 1e-10 * pivots.maxCoeff())) return std::nullopt;
  const Vector8d h = factored.solve(right);
  Eigen::Matrix3d normalized;
  normalized << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0;
  const Eigen::Matrix3d matrix = to_image.inverse() * normalized * to_plane;
  if (!matrix.allFinite()) return std::nullopt;
  return matrix;
}

std::vector<Eigen::Isometry3d> planarPoses(const std::vector<Eigen::Vector2d>& plane,
                                           const std::vector<Eigen::Vector2d>& normalized) {
  const std::optional<Eigen::Matrix3d> plane_to_image = homography(plane, normalized);
  if (!plane_to_image) return {};
  const Eigen::Vector2d centre = meanOf(plane);
  const Eigen::Vector3d at_centre = *plane_to_image * centre.homogeneous();
  const Eigen::Vector2d v = at_centre.hnormalized();
  const Eigen::Matrix2d patch =  // derivative of the homography at the centre
      (plane_to_image->topLeftCorner<2, 2>() - v * plane_to_image->block<1, 2>(2, 0)) / at_centre.z();

  // Rotation that takes the optical axis to the line of sight of the centre.
  const Eigen::Matrix3d to_sight =
      Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), v.homogeneous().normalized())
          .toRotationMatrix();
  const Eigen::Matrix2d sight_patch =
      to_sight.topLeftCorner<2, 2>() - v * to_sight.block<1, 2>(2, 0);
  const Eigen::Matrix2d a = sight_patch.inverse() * patch;
  // Its largest singular value is the inverse depth.
  const double half_trace = 0.5 * a.squaredNorm();
  const double inverse_depth =
      std::sqrt(half_trace + std::sqrt(std::max(0.0, half_trace * half_trace - std::pow(a.determinant(), 2))));
  if (!(inverse_depth > 0) || !std::isfinite(inverse_depth)) return {};
  const Eigen::Matrix2d upper = a / inverse_depth;
  Eigen::RowVector2d lower(std::sqrt(std::max(0.0, 1.0 - upper.col(0).squaredNorm())),
                           std::sqrt(std::max(0.0, 1.0 - upper.col(1).squaredNorm())));
  if (upper.col(0).dot(upper.col(1)) > 0) lower.y() = -lower.y();

  std::vector<Eigen::Isometry3d> poses;
  for (const double sign : {1.0, -1.0}) {
    Eigen::Vector3d x, y;
    x << upper.col(0), sign * lower.x();
    y << upper.col(1), sign * lower.y();
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    Eigen::Matrix3d rotation;
    rotation << x, y, x.cross(y);
    pose.linear() = Eigen::Quaterniond(Eigen::Matrix3d(to_sight * rotation)).normalized().toRotationMatrix();
    // Translation: (R X + t)_xy = n (R X + t)_z, least squares over all points.
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < plane.size(); ++i) {
      const Eigen::Vector3d turned = pose.linear().leftCols<2>() * plane[i];
      Eigen::Matrix<double, 2, 3> rows;
      rows << 1, 0, -normalized[i].x(), 0, 1, -normalized[i].y();
      normal += rows.transpose() * rows;
      right -= rows.transpose() * (rows * turned);
    }
    pose.translation() = normal.ldlt().solve(right);
    if (pose.matrix().allFinite() && pose.translation().z() > 0) poses.push_back(pose);
  }
  return poses;
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
