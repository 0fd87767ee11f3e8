// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/eye_to_hand.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "arrow.h"
#include "rigid_fit.h"
#include "se3.h"

namespace servocal::calib {
namespace {

using Affine = Eigen::Matrix<double, 3, 4>;

/// Standard deviations along the principal axes, greatest first.
Eigen::Vector3d extents(const std::vector<BoardPoint>& points) {
  std::vector<Eigen::Vector3d> all;
  for (const BoardPoint& point : points) all.push_back(point.in_camera);
  const Eigen::Vector3d mean = meanOf(all);
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& point : all) spread += (point - mean) * (point - mean).transpose();
  const Eigen::Vector3d values = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvalues();
  return values.cwiseMax(0.0).reverse().cwiseSqrt();
}

bool isFlat(const std::vector<BoardPoint>& points, int axis, const EyeToHandOptions& options) {
  const Eigen::Vector3d widths = extents(points);
  return !(widths[axis] > options.min_thickness * widths[0]);
}

Affine affineFit(const std::vector<BoardPoint>& points) {
  Eigen::MatrixX4d from(points.size(), 4);
  Eigen::MatrixX3d to(points.size(), 3);
  for (std::size_t i = 0; i < points.size(); ++i) {
    from.row(static_cast<Eigen::Index>(i)) = points[i].in_camera.homogeneous().transpose();
    to.row(static_cast<Eigen::Index>(i)) = points[i].in_base.transpose();
  }
  return from.colPivHouseholderQr().solve(to).transpose();
}

Affine rigidFitOf(const std::vector<BoardPoint>& points) {
  std::vector<Eigen::Vector3d> from, to;
  for (const BoardPoint& point : points) from.push_back(point.in_camera), to.push_back(point.in_base);
  return rigidFit(from, to).matrix().topRows<3>();
}

double errorM(const Affine& map, const BoardPoint& point) {
  return (map * point.in_camera.homogeneous() - point.in_base).norm();
}

/// The points that agree with the best of many models of `sample` points each.
template <class Fit>
std::vector<BoardPoint> consensus(const std::vector<BoardPoint>& points, std::size_t sample, int flat_axis,
                                  const Fit& fit, const EyeToHandOptions& options) {
  std::mt19937_64 random(options.seed);
  std::vector<BoardPoint> best, shuffled = points;
  double best_error = INFINITY;
  for (int draw = 0; draw < options.draws; ++draw) {
    for (std::size_t i = 0; i < sample; ++i) {
      std::swap(shuffled[i],
                shuffled[std::uniform_int_distribution<std::size_t>(i, shuffled.size() - 1)(random)]);
    }
    const std::vector<BoardPoint> few(shuffled.begin(),
                                      shuffled.begin() + static_cast<std::ptrdiff_t>(sample));
    if (isFlat(few, flat_axis, options)) continue;
    const Affine map = fit(few);
    std::vector<BoardPoint> agree;
    double error = 0.0;
    for (const BoardPoint& point : points) {
      const double off = errorM(map, point);
      if (off < options.inlier_m) agree.push_back(point), error += off;
    }
    if (agree.size() < best.size() || (agree.size() == best.size() && error >= best_error)) continue;
    best = std::move(agree);
    best_error = error;
  }
  return best;
}

/// Once more with all that agree with the fit of those that agreed.
template <class Fit>
std::vector<BoardPoint> widened(const std::vector<BoardPoint>& points, std::vector<BoardPoint> agree,
                                const Fit& fit, const EyeToHandOptions& options) {
  const Affine map = fit(agree);
  std::vector<BoardPoint> wide;
  for (const BoardPoint& point : points) {
    if (errorM(map, point) < options.inlier_m) wide.push_back(point);
  }
  return wide.size() >= agree.size() ? wide : agree;
}

RigidEyeToHand refined(const std::vector<BoardPoint>& points, RigidEyeToHand rigid) {
  Eigen::Isometry3d bMi = rigid.bMi.isometry();
  Eigen::Vector3d sigma = Eigen::Vector3d::Ones();
  Matrix6d information = Matrix6d::Zero();
  const double freedom = 1.0 - 6.0 / (3.0 * static_cast<double>(points.size()));
  for (int round = 0; round < 20; ++round) {
    information.setZero();
    Vector6d gradient = Vector6d::Zero();
    Eigen::Vector3d squares = Eigen::Vector3d::Zero();
    const Eigen::Matrix3d iRb = bMi.linear().transpose();
    for (const BoardPoint& point : points) {
      const Eigen::Vector3d arm = bMi.linear() * point.in_camera;
      const Eigen::Vector3d error = iRb * (arm + bMi.translation() - point.in_base);
      squares += error.cwiseAbs2();
      Eigen::Matrix<double, 3, 6> jacobian;
      jacobian << iRb, -iRb * skew(arm);
      const Eigen::Vector3d weight = sigma.cwiseAbs2().cwiseInverse();
      information += jacobian.transpose() * weight.asDiagonal() * jacobian;
      gradient += jacobian.transpose() * weight.cwiseProduct(error);
    }
    const double count = static_cast<double>(points.size()) * freedom;
    const double lateral = std::sqrt(std::max(0.5 * (squares.x() + squares.y()) / count, 1e-18));
    const double along = std::sqrt(std::max(squares.z() / count, 1e-18));
    const Vector6d step = -information.ldlt().solve(gradient);
    bMi.translation() += step.head<3>();
    bMi.linear() = rotationExp(step.tail<3>()) * bMi.linear();
    sigma << lateral, lateral, along;
  }
  rigid.bMi = Pose<Base, Infrared>(bMi);
  rigid.covariance = scaledInverse(information);
  rigid.lateral_sigma_m = sigma.x();
  rigid.depth_sigma_m = sigma.z();
  return rigid;
}

}  // namespace

const char* toString(EyeToHandStatus status) {
  switch (status) {
    case EyeToHandStatus::kSolved: return "eye-to-hand was solved from points";
    case EyeToHandStatus::kTooFewPoints: return "too few stops with depth and robot pose";
    case EyeToHandStatus::kPointsFlat:
      return "the points lie in a plane or on a line: take stops at two distances";
    case EyeToHandStatus::kNoConsensus: return "depth and robot contradict each other at most of the stops";
  }
  return "";
}

std::vector<BoardPoint> boardPoints(const BoardSpec& board, const DepthModel& depth,
                                    const std::vector<Observation>& observations, const std::string& camera,
                                    const Pose<EndEffector, Board>& eMo) {
  std::vector<BoardPoint> points;
  for (const Observation& observation : observations) {
    if (!observation.robot) continue;
    for (const StreamObservation& seen : observation.views) {
      if (seen.camera != camera || seen.stream != Stream::kInfrared || !seen.depth) continue;
      std::vector<Eigen::Vector3d> in_camera, in_base;
      for (const CornerDepth& corner : seen.depth->corners) {
        if (corner.id < 0 || corner.id >= board.cornerCount()) {
          throw std::invalid_argument("corner id " + std::to_string(corner.id) +
                                      " is not one of the board's");
        }
        const auto found = std::find_if(seen.detection.corners.begin(), seen.detection.corners.end(),
                                        [&](const Corner& other) { return other.id == corner.id; });
        if (found == seen.detection.corners.end()) continue;
        const auto ray = depth.camera.unproject(found->pixel);
        const auto along_m = depth.correct(found->pixel, corner.depth_m);
        if (!ray || !along_m) continue;
        in_camera.push_back(*along_m * ray->homogeneous());
        in_base.push_back(observation.robot->bMe * eMo * board.corner(corner.id));
      }
      if (in_camera.size() < 4) continue;
      points.push_back({observation.id, meanOf(in_camera), meanOf(in_base)});
    }
  }
  return points;
}

AffineOutcome solveAffineEyeToHand(const std::vector<BoardPoint>& points, const EyeToHandOptions& options) {
  if (points.size() < 5) return {EyeToHandStatus::kTooFewPoints, {}};
  if (isFlat(points, 2, options)) return {EyeToHandStatus::kPointsFlat, {}};
  std::vector<BoardPoint> agree = consensus(points, 4, 2, affineFit, options);
  if (agree.size() < 5 || 2 * agree.size() < points.size()) return {EyeToHandStatus::kNoConsensus, {}};
  agree = widened(points, std::move(agree), affineFit, options);
  if (isFlat(agree, 2, options)) return {EyeToHandStatus::kPointsFlat, {}};
  AffineEyeToHand result;
  result.bAc = affineFit(agree);
  double squares = 0.0;
  for (const BoardPoint& point : agree) squares += std::pow(errorM(result.bAc, point), 2);
  result.rms_m = std::sqrt(squares / static_cast<double>(agree.size()));
  result.inliers = static_cast<int>(agree.size());
  result.points = static_cast<int>(points.size());
  return {EyeToHandStatus::kSolved, result};
}

RigidOutcome solveRigidEyeToHand(const std::vector<BoardPoint>& points, const EyeToHandOptions& options) {
  if (points.size() < 4) return {EyeToHandStatus::kTooFewPoints, {}};
  if (isFlat(points, 1, options)) return {EyeToHandStatus::kPointsFlat, {}};
  std::vector<BoardPoint> agree = consensus(points, 3, 1, rigidFitOf, options);
  if (agree.size() < 4 || 2 * agree.size() < points.size()) return {EyeToHandStatus::kNoConsensus, {}};
  agree = widened(points, std::move(agree), rigidFitOf, options);
  if (isFlat(agree, 1, options)) return {EyeToHandStatus::kPointsFlat, {}};
  RigidEyeToHand result;
  const Affine start = rigidFitOf(agree);
  result.bMi = Pose<Base, Infrared>(start.leftCols<3>(), start.col(3));
  result.inliers = static_cast<int>(agree.size());
  result.points = static_cast<int>(points.size());
  return {EyeToHandStatus::kSolved, refined(agree, result)};
}

}  // namespace servocal::calib
