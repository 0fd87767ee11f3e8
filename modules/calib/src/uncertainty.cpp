// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/uncertainty.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "map_rows.h"
#include "se3.h"

namespace servocal::calib {
namespace {

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
