// SPDX-License-Identifier: GPL-3.0-or-later
#include "way.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace servocal::plan {
namespace {

bool nearSingular(const robot::Guard& guard, const Eigen::VectorXd& q, double min_singular_value) {
  const Eigen::MatrixXd jacobian = guard.kinematics().jacobian(q);
  // The squares of the singular values are the eigenvalues of the smaller of the two products, of which a
  // Cholesky decomposition asks for less than an SVD.
  Eigen::MatrixXd squares = jacobian.rows() <= jacobian.cols()
                                ? Eigen::MatrixXd(jacobian * jacobian.transpose())
                                : Eigen::MatrixXd(jacobian.transpose() * jacobian);
  squares.diagonal().array() -= min_singular_value * min_singular_value;
  return squares.llt().info() != Eigen::Success;
}

}  // namespace

std::optional<std::vector<Eigen::Vector2d>> visibleCorners(const Pose<Color, Board>& cMo,
                                                           const CameraModel& camera,
                                                           const BoardPoints& board, double margin_px) {
  for (const Eigen::Vector3d& point : board.outline) {
    const auto pixel = camera.project(cMo * point);
    if (!pixel || !camera.contains(*pixel, margin_px)) return std::nullopt;
  }
  std::vector<Eigen::Vector2d> pixels;
  pixels.reserve(board.corners.size());
  for (const Eigen::Vector3d& corner : board.corners) {
    const auto pixel = camera.project(cMo * corner);
    if (!pixel) return std::nullopt;
    pixels.push_back(*pixel);
  }
  return pixels;
}

double travelTimeS(const Pose<Base, EndEffector>& from, const Pose<Base, EndEffector>& to,
                   const MotionLimits& limits) {
  return std::max(distanceM(from, to) / limits.max_speed_mps,
                  angleRad(from, to) / limits.max_angular_speed_radps);
}

bool straightWayFree(const robot::Guard& guard, const Eigen::VectorXd& from_q,
                     const Pose<Base, EndEffector>& bMe_goal, double min_singular_value) {
  constexpr double kMaxJointStepRad = 0.5;
  const Pose<Base, EndEffector> bMe_from = guard.kinematics().forward(from_q);
  const Eigen::Quaterniond q_from = bMe_from.quaternion(), q_goal = bMe_goal.quaternion();
  const int steps = 2 + static_cast<int>(std::max(distanceM(bMe_from, bMe_goal) / 0.05,
                                                  angleRad(bMe_from, bMe_goal) / 0.15));
  Eigen::VectorXd q = from_q;
  for (int i = 1; i <= steps; ++i) {
    const double t = double(i) / steps;
    const auto bMe = Pose<Base, EndEffector>::fromQuaternion(
        q_from.slerp(t, q_goal), (1 - t) * bMe_from.translation() + t * bMe_goal.translation());
    if (!guard.allows(bMe)) return false;
    const auto next = guard.kinematics().inverse(bMe, q, guard.limits().joint_margin_rad);
    if (!next || (*next - q).cwiseAbs().maxCoeff() > kMaxJointStepRad) return false;
    if (!guard.allows(*next) || nearSingular(guard, *next, min_singular_value)) return false;
    q = *next;
  }
  return true;
}

bool isTried(const std::vector<Pose<Color, Board>>& tried, const Pose<Color, Board>& cdMo) {
  return std::any_of(tried.begin(), tried.end(), [&](const Pose<Color, Board>& old) {
    return distanceM(cdMo, old) < 0.03 && angleRad(cdMo, old) < 0.1;
  });
}

}  // namespace servocal::plan
