// SPDX-License-Identifier: GPL-3.0-or-later
#include "depth_views.h"

#include <cmath>
#include <stdexcept>

#include "arrow.h"
#include "corner_weight.h"
#include "se3.h"
#include "servocal/calib/board_pose.h"

namespace servocal::calib {
namespace {

/// Depth of the plane along a ray; nothing if they do not meet in front of the camera.
std::optional<double> planeDepth(const Eigen::Isometry3d& iMo, const Eigen::Vector3d& ray) {
  const Eigen::Vector3d normal = iMo.linear().col(2);
  const double depth = normal.dot(iMo.translation()) / normal.dot(ray);
  if (!(depth > 0.0) || !std::isfinite(depth)) return std::nullopt;
  return depth;
}

/// Covariance of a pose (motion on the left, as in se3.h) by the corners it was fitted to; enlarged if they fit
/// worse than they claim.
std::optional<Matrix6d> poseCovariance(const BoardSpec& board, const CameraModel& infrared,
                                       const BoardDetection& detection, const Eigen::Isometry3d& iMo) {
  Matrix6d information = Matrix6d::Zero();
  double squares = 0.0;
  ProjectionJacobian derivative;
  for (const Corner& corner : detection.corners) {
    const Eigen::Vector3d point = iMo * board.corner(corner.id);
    const auto pixel = infrared.project(point, derivative);
    if (!pixel) return std::nullopt;
    const Eigen::Matrix2d weight = whitening(corner);
    const Eigen::Matrix<double, 2, 6> jacobian = weight * derivative.point * pointByMotion(point);
    information += jacobian.transpose() * jacobian;
    squares += (weight * (*pixel - corner.pixel)).squaredNorm();
  }
  const double freedom = 2.0 * static_cast<double>(detection.corners.size()) - 6.0;
  const double excess = freedom > 0.0 ? std::max(1.0, squares / freedom) : 1.0;
  return excess * scaledInverse(information);
}

/// Scatter of measured over expected depth about its mean: which of two planes the depth image shows.
double mismatch(const Eigen::Isometry3d& iMo, const std::vector<Eigen::Vector3d>& rays,
                const Eigen::VectorXd& raw_m) {
  Eigen::VectorXd ratio(raw_m.size());
  for (Eigen::Index k = 0; k < raw_m.size(); ++k) {
    const auto depth = planeDepth(iMo, rays[static_cast<std::size_t>(k)]);
    if (!depth) return INFINITY;
    ratio[k] = raw_m[k] / *depth;
  }
  return (ratio.array() - ratio.mean()).square().sum();
}

}  // namespace

std::optional<DepthView> depthView(const BoardSpec& board, const CameraModel& infrared,
                                   const Observation& observation, const StreamObservation& seen,
                                   const DepthOptions& options) {
  DepthView view;
  view.id = observation.id;
  std::vector<Eigen::Vector3d> rays;
  std::vector<double> raw, sigma;
  for (const DepthPatch& patch : seen.depth->patches) {
    if (!patch.pixel.allFinite() || !std::isfinite(patch.depth_m) || !(patch.depth_m > 0.0) ||
        !std::isfinite(patch.sigma_m) || !(patch.sigma_m > 0.0)) {
      throw std::invalid_argument("a depth patch of observation " + std::to_string(observation.id) +
                                  " is not finite and positive");
    }
    const auto ray = infrared.unproject(patch.pixel);
    if (!ray) continue;
    rays.push_back(ray->homogeneous());
    view.pixels.push_back(patch.pixel);
    raw.push_back(patch.depth_m);
    sigma.push_back(patch.sigma_m);
  }
  if (rays.empty()) return std::nullopt;
  const auto count = static_cast<Eigen::Index>(rays.size());
  view.raw_m = Eigen::Map<const Eigen::VectorXd>(raw.data(), count);
  view.raw_sigma_m = Eigen::Map<const Eigen::VectorXd>(sigma.data(), count);

  Eigen::Isometry3d iMo;
  Matrix6d covariance;
  const auto given = options.board_poses.find(observation.id);
  if (given != options.board_poses.end()) {
    iMo = given->second.isometry();
    // Turns are about the board, whose place is known to board_pose_sigma_m.
    const Matrix36d arm = pointByMotion(iMo.translation());
    covariance.setZero();
    covariance.bottomRightCorner<3, 3>().diagonal().setConstant(std::pow(options.board_pose_sigma_rad, 2));
    covariance.topLeftCorner<3, 3>() =
        std::pow(options.board_pose_sigma_rad, 2) * arm.rightCols<3>() * arm.rightCols<3>().transpose();
    covariance.topLeftCorner<3, 3>().diagonal().array() += std::pow(options.board_pose_sigma_m, 2);
    covariance.topRightCorner<3, 3>() = -std::pow(options.board_pose_sigma_rad, 2) * arm.rightCols<3>();
    covariance.bottomLeftCorner<3, 3>() = covariance.topRightCorner<3, 3>().transpose();
  } else {
    double least = INFINITY;
    for (const BoardPose& pose : boardPoses(board, infrared, seen.detection)) {
      const double scatter = mismatch(pose.cMo.isometry(), rays, view.raw_m);
      if (!(scatter < least)) continue;
      least = scatter;
      iMo = pose.cMo.isometry();
    }
    if (!std::isfinite(least)) return std::nullopt;
    const auto known = poseCovariance(board, infrared, seen.detection, iMo);
    if (!known) return std::nullopt;
    covariance = *known;
  }

  view.plane_m.resize(count);
  view.stretch.resize(count);
  Eigen::MatrixXd by_motion(count, 6);
  const Eigen::Vector3d normal = iMo.linear().col(2);
  for (Eigen::Index k = 0; k < count; ++k) {
    const Eigen::Vector3d& ray = rays[static_cast<std::size_t>(k)];
    const auto depth = planeDepth(iMo, ray);
    if (!depth) return std::nullopt;
    view.plane_m[k] = *depth;
    view.stretch[k] = ray.norm();
    by_motion.row(k) = normal.transpose() * pointByMotion(*depth * ray) / normal.dot(ray);
  }
  view.plane_covariance_m2 = by_motion * covariance * by_motion.transpose();
  return view;
}

}  // namespace servocal::calib
