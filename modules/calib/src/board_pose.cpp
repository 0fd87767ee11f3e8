// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/board_pose.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "corner_weight.h"
#include "homography.h"
#include "se3.h"

namespace servocal::calib {
namespace {

struct WeightedCorner {
  Eigen::Vector3d point_o;
  Eigen::Vector2d pixel;
  Eigen::Matrix2d weight;
};

std::vector<WeightedCorner> weightedCorners(const BoardSpec& board, const BoardDetection& detection) {
  std::vector<WeightedCorner> corners;
  corners.reserve(detection.corners.size());
  for (const Corner& corner : detection.corners) {
    if (corner.id < 0 || corner.id >= board.cornerCount()) {
      throw std::invalid_argument("corner id " + std::to_string(corner.id) + " is not on the board");
    }
    corners.push_back({board.corner(corner.id), corner.pixel, whitening(corner)});
  }
  return corners;
}

/// True if the corners span a plane: otherwise the rotation about their line is anybody's guess.
bool spanPlane(const std::vector<WeightedCorner>& corners, double spacing_m) {
  if (corners.size() < 4) return false;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const WeightedCorner& corner : corners) mean += corner.point_o.head<2>();
  mean /= static_cast<double>(corners.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const WeightedCorner& corner : corners) {
    const Eigen::Vector2d offset = corner.point_o.head<2>() - mean;
    scatter += offset * offset.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(scatter, Eigen::EigenvaluesOnly);
  return eigen.eigenvalues()[0] > 0.01 * spacing_m * spacing_m;
}

struct Normal {
  Matrix6d matrix = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double cost = 0.0;     // whitened
  double cost_px2 = 0.0;
};

std::optional<Normal> linearize(const CameraModel& camera, const std::vector<WeightedCorner>& corners,
                                const Eigen::Isometry3d& cMo, ProjectionJacobian& scratch) {
  Normal normal;
  for (const WeightedCorner& corner : corners) {
    const Eigen::Vector3d point_c = cMo * corner.point_o;
    const std::optional<Eigen::Vector2d> pixel = camera.project(point_c, scratch);
    if (!pixel) return std::nullopt;
    const Eigen::Vector2d error = *pixel - corner.pixel;
    const Eigen::Vector2d whitened = corner.weight * error;
    const Eigen::Matrix<double, 2, 6> jacobian = corner.weight * scratch.point * pointByMotion(point_c);
    normal.matrix.noalias() += jacobian.transpose() * jacobian;
    normal.gradient.noalias() += jacobian.transpose() * whitened;
    normal.cost += whitened.squaredNorm();
    normal.cost_px2 += error.squaredNorm();
  }
  return normal;
}

std::optional<BoardPose> refine(const CameraModel& camera, const std::vector<WeightedCorner>& corners,
                                Eigen::Isometry3d cMo) {
  ProjectionJacobian scratch;
  std::optional<Normal> normal = linearize(camera, corners, cMo, scratch);
  if (!normal) return std::nullopt;
  double damping = 0.0;
  for (int iteration = 0; iteration < 20; ++iteration) {
    Matrix6d matrix = normal->matrix;
    matrix.diagonal() *= 1.0 + damping;
    const Vector6d step = -matrix.ldlt().solve(normal->gradient);
    const double decrement = -step.dot(normal->gradient);
    // In standard deviations: a ten-thousandth of what the noise leaves open.
    if (!std::isfinite(decrement) || (damping == 0.0 && decrement < 1e-8)) break;
    const Eigen::Isometry3d trial_pose = moved(cMo, step);
    const std::optional<Normal> trial = linearize(camera, corners, trial_pose, scratch);
    if (trial && trial->cost <= normal->cost) {
      cMo = trial_pose;
      normal = trial;
      damping = damping < 1e-3 ? 0.0 : damping * 0.1;
    } else {
      damping = std::max(10.0 * damping, 1e-3);
      if (damping > 1e8) break;
    }
  }
  return BoardPose{Pose<Color, Board>(cMo), std::sqrt(normal->cost_px2 / corners.size())};
}

/// True if two poses put the board's corners at the same places, to a thousandth of their spacing.
bool same(const BoardPose& first, const BoardPose& second, double spacing_m) {
  return distanceM(first.cMo, second.cMo) < 1e-3 * spacing_m && angleRad(first.cMo, second.cMo) < 1e-3;
}

}  // namespace

std::vector<BoardPose> boardPoses(const BoardSpec& board, const CameraModel& camera,
                                  const BoardDetection& detection) {
  std::vector<WeightedCorner> corners;
  std::vector<Eigen::Vector2d> plane, normalized;
  for (const WeightedCorner& corner : weightedCorners(board, detection)) {
    const std::optional<Eigen::Vector2d> ray = camera.unproject(corner.pixel);
    if (!ray) continue;
    corners.push_back(corner);
    plane.push_back(corner.point_o.head<2>());
    normalized.push_back(*ray);
  }
  std::vector<BoardPose> poses;
  if (!spanPlane(corners, board.spacing())) return poses;
  for (const Eigen::Isometry3d& start : planarPoses(plane, normalized)) {
    const std::optional<BoardPose> pose = refine(camera, corners, start);
    if (!pose || !pose->cMo.isFinite()) continue;
    const bool known = std::any_of(poses.begin(), poses.end(), [&](const BoardPose& other) {
      return same(*pose, other, board.spacing());
    });
    if (!known) poses.push_back(*pose);
  }
  std::stable_sort(poses.begin(), poses.end(),
                   [](const BoardPose& a, const BoardPose& b) { return a.rms_px < b.rms_px; });
  return poses;
}

std::optional<BoardPose> refineBoardPose(const BoardSpec& board, const CameraModel& camera,
                                         const BoardDetection& detection,
                                         const Pose<Color, Board>& start) {
  if (!start.isFinite()) throw std::invalid_argument("the start pose is not finite");
  const std::vector<WeightedCorner> corners = weightedCorners(board, detection);
  if (!spanPlane(corners, board.spacing())) return std::nullopt;
  return refine(camera, corners, start.isometry());
}

}  // namespace servocal::calib
