// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/hand_eye.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <cmath>
#include <stdexcept>
#include <string>

namespace servocal::calib {
namespace {

/// Rotation nearest to a matrix (Frobenius norm).
Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1.0 : 1.0;
  return svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
}

/// Rotation vector of first * second^-1, of the shorter way round.
Eigen::Vector3d rotationBetween(const Eigen::Quaterniond& first, const Eigen::Quaterniond& second) {
  Eigen::Quaterniond q = first * second.conjugate();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double sine = q.vec().norm();
  if (!(sine > 0)) return Eigen::Vector3d::Zero();
  return q.vec() * (2.0 * std::atan2(sine, q.w()) / sine);
}

/// Pairs near half a turn are left out: there noise flips the sign of the axis.
constexpr double kMaxRotationRad = 2.8;

}  // namespace

const char* toString(HandEyeStatus status) {
  switch (status) {
    case HandEyeStatus::kSolved: return "Solved.";
    case HandEyeStatus::kTooFewViews:
      return "Too few views: at least three with a robot pose and a board pose are needed. Add views.";
    case HandEyeStatus::kRotationAxesParallel:
      return "The robot turned about (nearly) one axis only, or not at all; the camera's place along that "
             "axis cannot be known. Add views turned about another axis by 10 degrees or more.";
    case HandEyeStatus::kInconsistent:
      return "Robot poses and images contradict each other. Check that poses and images belong together, "
             "the units and direction of the robot poses, and the size of the board's squares.";
    case HandEyeStatus::kNotConverged:
      return "The solve did not converge. Look for wrong detections, and add views.";
  }
  return "Unknown status.";
}

HandEyeResult solveHandEye(const std::vector<HandEyeView>& views, const HandEyeOptions& options) {
  HandEyeResult result;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (!views[i].bMe.isFinite() || !views[i].cMo.isFinite()) {
      throw std::invalid_argument("view " + std::to_string(i) + " holds a pose that is not finite");
    }
  }
  if (views.size() < 3) return result;

  std::vector<Eigen::Quaterniond> q_be, q_co;
  for (const HandEyeView& view : views) {
    q_be.push_back(view.bMe.quaternion());
    q_co.push_back(view.cMo.quaternion());
  }
  // Of every pair, the rotation seen from the base (alpha) and from the camera (beta): alpha = bRc beta.
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (std::size_t j = i + 1; j < views.size(); ++j) {
      const Eigen::Vector3d alpha = rotationBetween(q_be[j], q_be[i]);
      const double angle = alpha.norm();
      if (angle < options.min_rotation_rad) continue;
      axes += alpha * alpha.transpose() / (angle * angle);
      if (angle > kMaxRotationRad) continue;
      const Eigen::Vector3d beta = rotationBetween(q_co[j], q_co[i]);
      if (beta.norm() > M_PI - 0.5 * (M_PI - kMaxRotationRad)) continue;
      correlation += alpha * beta.transpose();
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spread(axes, Eigen::EigenvaluesOnly);
  if (spread.eigenvalues()[2] > 0) {
    result.axis_spread = std::max(0.0, spread.eigenvalues()[1] / spread.eigenvalues()[2]);
  }
  if (!(result.axis_spread >= options.min_axis_spread) || correlation.isZero(0.0)) {
    result.status = HandEyeStatus::kRotationAxesParallel;
    return result;
  }
  const Eigen::Matrix3d bRc = nearestRotation(correlation);

  // bRe_i t_eo - t_bc - s bRc t_co_i = -t_be_i: both translations and the scale s at once, each view
  // counted once. Without a free scale, s = 1 moves to the right.
  const int unknowns = options.free_scale ? 7 : 6;
  Eigen::Matrix<double, 7, 7> matrix = Eigen::Matrix<double, 7, 7>::Zero();
  Eigen::Matrix<double, 7, 1> right = Eigen::Matrix<double, 7, 1>::Zero();
  for (const HandEyeView& view : views) {
    const Eigen::Vector3d seen_b = bRc * view.cMo.translation();
    Eigen::Matrix<double, 3, 7> row;
    row << view.bMe.rotation(), -Eigen::Matrix3d::Identity(), -seen_b;
    matrix += row.transpose() * row;
    right -= row.transpose() * view.bMe.translation();
    if (!options.free_scale) right += row.transpose() * seen_b;
  }
  const Eigen::VectorXd translations =
      matrix.topLeftCorner(unknowns, unknowns).ldlt().solve(right.head(unknowns));
  if (options.free_scale) result.scale = translations[6];

  Eigen::Matrix3d rotation_sum = Eigen::Matrix3d::Zero();
  for (const HandEyeView& view : views) {
    rotation_sum += view.bMe.rotation().transpose() * bRc * view.cMo.rotation();
  }
  const Pose<Base, Color> bMc(bRc, translations.segment<3>(3));
  const Pose<EndEffector, Board> eMo(nearestRotation(rotation_sum), translations.head<3>());

  double squared_m = 0, squared_rad = 0;
  for (const HandEyeView& view : views) {
    const Pose<Color, Board> cMo(view.cMo.rotation(), result.scale * view.cMo.translation());
    const Pose<EndEffector, Board> seen = view.bMe.inverse() * bMc * cMo;
    squared_m += std::pow(distanceM(seen, eMo), 2);
    squared_rad += std::pow(angleRad(seen, eMo), 2);
  }
  result.status = HandEyeStatus::kSolved;
  result.bMc = bMc;
  result.eMo = eMo;
  result.rms_translation_m = std::sqrt(squared_m / views.size());
  result.rms_rotation_rad = std::sqrt(squared_rad / views.size());
  return result;
}

}  // namespace servocal::calib
