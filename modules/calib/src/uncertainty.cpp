// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/uncertainty.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "se3.h"

namespace servocal::calib {
namespace {

using Rows = Eigen::MatrixXd;

/// A point of the camera frame with the derivatives that every map is made of.
struct Seen {
  ProjectionJacobian by;
  Eigen::Vector3d point_c;
};

std::optional<Seen> seenAt(const JointCamera& camera, const Eigen::Vector3d& point_c) {
  Seen out;
  out.point_c = point_c;
  if (!camera.model.project(point_c, out.by)) return std::nullopt;
  return out;
}

/// The pixel's columns for the free intrinsics.
Rows byIntrinsics(const JointCamera& camera, const ProjectionJacobian& by) {
  Rows out(2, static_cast<Eigen::Index>(camera.free.size()));
  for (std::size_t p = 0; p < camera.free.size(); ++p) {
    out.col(static_cast<Eigen::Index>(p)) = by.parameters.col(camera.free[p]);
  }
  return out;
}

/// The pixel of a fixed point, by the camera's pose: displacement, turn, along the axes of the left frame. A
/// point at infinity does not feel the displacement; its `point_c` is a direction of length one in z.
Eigen::Matrix<double, 2, 6> byPose(const JointCamera& camera, const Seen& seen, bool at_infinity) {
  const Eigen::Matrix<double, 2, 3> by_l = seen.by.point * camera.pose.linear().transpose();
  Eigen::Matrix<double, 2, 6> out;
  out << -by_l, by_l * skew(camera.pose.linear() * seen.point_c);
  if (at_infinity) out.leftCols<3>().setZero();
  return out;
}

/// Rays of a grid over the image, at this depth; those that the model cannot unproject are nothing.
std::vector<std::optional<Seen>> grid(const JointCamera& camera, int cells_x, int cells_y, double depth_m) {
  std::vector<std::optional<Seen>> out;
  for (int y = 0; y < cells_y; ++y) {
    for (int x = 0; x < cells_x; ++x) {
      const Eigen::Vector2d pixel(x * (camera.model.width_px - 1.0) / std::max(1, cells_x - 1),
                                  y * (camera.model.height_px - 1.0) / std::max(1, cells_y - 1));
      const auto ray = camera.model.unproject(pixel);
      out.push_back(ray ? seenAt(camera, depth_m * Eigen::Vector3d(ray->x(), ray->y(), 1.0)) : std::nullopt);
    }
  }
  return out;
}

double worstSigma(const Eigen::MatrixXd& covariance) {
  if (!covariance.allFinite()) return NAN;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, eigen.eigenvalues().maxCoeff()));
}

/// Covariance of a camera's intrinsics and pose.
Eigen::MatrixXd ownCovariance(const JointSolution& solution, const JointCamera& camera) {
  const auto size = static_cast<Eigen::Index>(camera.free.size()) + 6;
  return solution.covariance.block(camera.intrinsics_at, camera.intrinsics_at, size, size);
}

/// Where a pixel with its depth held comes to lie in the frame the camera stands in, by intrinsics and pose.
std::optional<Rows> byBackProjection(const JointCamera& camera, const Eigen::Vector3d& point_l) {
  const Eigen::Vector3d point_c = camera.pose.inverse() * point_l;
  const auto seen = seenAt(camera, point_c);
  if (!seen) return std::nullopt;
  const auto pixel = camera.model.project(point_c);
  if (!pixel || !camera.model.contains(*pixel)) return std::nullopt;
  const Eigen::Matrix2d by_plane = seen->by.point.leftCols<2>();  // by X, Y at this depth
  Rows by_c = Rows::Zero(3, static_cast<Eigen::Index>(camera.free.size()));
  by_c.topRows<2>() = -by_plane.inverse() * byIntrinsics(camera, seen->by);
  Rows out(3, by_c.cols() + 6);
  out << camera.pose.linear() * by_c, Eigen::Matrix3d::Identity(), -skew(camera.pose.linear() * point_c);
  return out;
}

template <class Covariance>
WorkspaceMap mapOver(const Box& box, int cells, const Covariance& covariance_at) {
  WorkspaceMap map;
  map.cells_x = map.cells_y = map.cells_z = std::max(2, cells);
  double squares = 0;
  for (int z = 0; z < map.cells_z; ++z) {
    for (int y = 0; y < map.cells_y; ++y) {
      for (int x = 0; x < map.cells_x; ++x) {
        const Eigen::Vector3d share = Eigen::Vector3d(x, y, z) / (map.cells_x - 1.0);
        const Eigen::Vector3d point = box.min_m + share.cwiseProduct(box.max_m - box.min_m);
        const std::optional<Eigen::Matrix3d> covariance = covariance_at(point);
        map.sigma_m.push_back(covariance ? std::sqrt(covariance->trace()) : NAN);
        if (!covariance) continue;
        ++map.seen;
        squares += covariance->trace();
        map.worst_m = map.sigma_m.back() <= map.worst_m ? map.worst_m : map.sigma_m.back();  // keeps NaN
      }
    }
  }
  map.rms_m = map.seen > 0 ? std::sqrt(squares / map.seen) : NAN;
  return map;
}

}  // namespace

std::vector<Eigen::Vector3d> shapedCorners(const BoardSpec& board, const BoardShape& shape) {
  std::vector<Eigen::Vector3d> corners = board.corners();
  Eigen::Vector2d half_m = Eigen::Vector2d::Constant(1e-9);
  for (const Eigen::Vector3d& corner : corners) half_m = half_m.cwiseMax(corner.head<2>().cwiseAbs());
  for (Eigen::Vector3d& corner : corners) {
    const Eigen::Vector2d share = corner.head<2>().cwiseQuotient(half_m);
    corner = {shape.scale_x * corner.x(), shape.scale_y * corner.y(),
              shape.bow_x_m * (1.0 - share.x() * share.x()) + shape.bow_y_m * (1.0 - share.y() * share.y())};
  }
  return corners;
}

ProjectionMap projectionMap(const JointSolution& solution, const JointCamera& camera, Anchor anchor,
                            std::optional<double> distance_m, int cells_x, int cells_y) {
  const bool at_infinity = !distance_m;
  const auto seen = grid(camera, cells_x, cells_y, distance_m.value_or(1.0));
  const Eigen::MatrixXd covariance = ownCovariance(solution, camera);
  const auto lens = static_cast<Eigen::Index>(camera.free.size());

  // The motion of the camera that takes up most of an intrinsics error, over the whole image.
  Eigen::MatrixXd compensation = Eigen::MatrixXd::Zero(6, lens);
  if (anchor == Anchor::kIntrinsics) {
    const Eigen::Index dof = at_infinity ? 3 : 6;
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(dof, dof), right = Eigen::MatrixXd::Zero(dof, lens);
    for (const auto& point : seen) {
      if (!point) continue;
      const Eigen::MatrixXd by_pose = byPose(camera, *point, at_infinity).rightCols(dof);
      matrix += by_pose.transpose() * by_pose;
      right += by_pose.transpose() * byIntrinsics(camera, point->by);
    }
    compensation.bottomRows(dof) = -matrix.ldlt().solve(right);
  }

  ProjectionMap map{cells_x, cells_y, {}, 0.0, 0.0};
  double squares = 0;
  for (const auto& point : seen) {
    if (!point) {
      map.sigma_px.push_back(NAN);
      continue;
    }
    Eigen::MatrixXd by(2, lens + 6);
    by << byIntrinsics(camera, point->by), byPose(camera, *point, at_infinity);
    const Eigen::Matrix2d spread =
        anchor == Anchor::kBase ? Eigen::Matrix2d(by * covariance * by.transpose()) : [&] {
          const Eigen::MatrixXd alone = by.leftCols(lens) + by.rightCols<6>() * compensation;
          return Eigen::Matrix2d(alone * covariance.topLeftCorner(lens, lens) * alone.transpose());
        }();
    map.sigma_px.push_back(worstSigma(spread));
    squares += 0.5 * spread.trace();
  }
  // Not std::max: a NaN must not get lost.
  for (const double sigma : map.sigma_px) map.worst_px = sigma <= map.worst_px ? map.worst_px : sigma;
  map.rms_px = std::sqrt(squares / static_cast<double>(map.sigma_px.size()));
  return map;
}

WorkspaceMap workspaceMap(const JointSolution& solution, const JointCamera& camera, const Box& box,
                          int cells) {
  const Eigen::MatrixXd covariance = ownCovariance(solution, camera);
  return mapOver(box, cells, [&](const Eigen::Vector3d& point) -> std::optional<Eigen::Matrix3d> {
    const auto by = byBackProjection(camera, point);
    if (!by) return std::nullopt;
    return Eigen::Matrix3d(*by * covariance * by->transpose());
  });
}

WorkspaceMap disagreementMap(const JointSolution& solution, const JointCamera& first,
                             const JointCamera& second, const Box& box, int cells) {
  const Eigen::Index a = first.intrinsics_at, b = second.intrinsics_at;
  const Eigen::MatrixXd of_first = ownCovariance(solution, first),
                        of_second = ownCovariance(solution, second);
  const Eigen::MatrixXd cross = solution.covariance.block(a, b, of_first.rows(), of_second.rows());
  return mapOver(box, cells, [&](const Eigen::Vector3d& point) -> std::optional<Eigen::Matrix3d> {
    const auto by_first = byBackProjection(first, point), by_second = byBackProjection(second, point);
    if (!by_first || !by_second) return std::nullopt;
    const Eigen::Matrix3d both = *by_first * cross * by_second->transpose();
    return Eigen::Matrix3d(*by_first * of_first * by_first->transpose() - both - both.transpose() +
                           *by_second * of_second * by_second->transpose());
  });
}

CameraPair cameraPairOf(const JointSolution& solution, const JointCamera& first, const JointCamera& second) {
  CameraPair pair;
  pair.first = first.camera;
  pair.second = second.camera;
  pair.first_by_second = first.pose.inverse() * second.pose;
  const Eigen::Matrix3d cRl = first.pose.linear().transpose();
  const Eigen::Vector3d apart_l = second.pose.translation() - first.pose.translation();
  Eigen::Matrix<double, 6, 12> by = Eigen::Matrix<double, 6, 12>::Zero();
  by.block<3, 3>(0, 0) = -cRl;
  by.block<3, 3>(0, 3) = cRl * skew(apart_l);
  by.block<3, 3>(3, 3) = -cRl;
  by.block<3, 3>(0, 6) = cRl;
  by.block<3, 3>(3, 9) = cRl;
  Eigen::Matrix<double, 12, 12> covariance;
  covariance << solution.covariance.block<6, 6>(first.pose_at, first.pose_at),
      solution.covariance.block<6, 6>(first.pose_at, second.pose_at),
      solution.covariance.block<6, 6>(second.pose_at, first.pose_at),
      solution.covariance.block<6, 6>(second.pose_at, second.pose_at);
  pair.covariance = by * covariance * by.transpose();
  return pair;
}

}  // namespace servocal::calib
