// SPDX-License-Identifier: GPL-3.0-or-later
#include "hand_eye_problem.h"

#include <cmath>

#include "corner_weight.h"

namespace servocal::calib {
namespace {

/// The pose after a displacement of its origin and a turn about it, along the axes of the left frame.
Eigen::Isometry3d movedAboutOrigin(const Eigen::Isometry3d& pose, const Eigen::Ref<const Vector6d>& step) {
  Eigen::Isometry3d out = pose;
  out.linear() = rotationExp(step.tail<3>()) * pose.linear();
  out.translation() += step.head<3>();
  return out;
}

}  // namespace

HandEyeProblem::HandEyeProblem(const BoardSpec& board, const CameraModel& camera,
                               const ReprojectionOptions& options)
    : camera_(camera), options_(options), points_o_(board.corners()), turns_(board) {
  prior_root_ << Eigen::Vector3d::Constant(1.0 / options.robot_sigma_m),
      Eigen::Vector3d::Constant(1.0 / options.robot_sigma_rad);
}

void HandEyeProblem::setViews(std::vector<HandEyeStop> views) {
  views_ = std::move(views);
  belief_.assign(views_.size(), 1.0);
  weights_.clear();
  for (const HandEyeStop& view : views_) {
    weights_.emplace_back();
    for (const Corner& corner : view.detection->corners) weights_.back().push_back(whitening(corner));
  }
}

std::optional<ArrowSystem> HandEyeProblem::linearize(const HandEyeState& state) const {
  ArrowSystem system(12, static_cast<int>(views_.size()));
  const Eigen::Matrix3d cRl = state.lMc.linear().transpose();
  const bool fixed = options_.mount == Mount::kFixed;
  ProjectionJacobian derivative;
  Eigen::MatrixXd jacobian;
  Eigen::VectorXd residual;
  double robust_excess = 0;  // robust cost minus the weighted squares that stand for it
  for (std::size_t i = 0; i < views_.size(); ++i) {
    const HandEyeStop& view = views_[i];
    const Eigen::Vector3d shift = state.corrections[i].head<3>(), turn = state.corrections[i].tail<3>();
    const Eigen::Matrix3d correction = rotationExp(turn), turn_jacobian = rightJacobian(turn);
    const Eigen::Matrix3d lRr = view.lMr.linear();
    const Eigen::Matrix3d l_by_r = fixed ? lRr * correction : correction * lRr;
    const Eigen::Matrix3d l_by_e = fixed ? lRr : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
    const std::vector<Corner>& corners = view.detection->corners;
    const Eigen::Index rows = 2 * static_cast<Eigen::Index>(corners.size());
    jacobian.resize(rows + 6, 18);
    residual.resize(rows + 6);
    for (std::size_t k = 0; k < corners.size(); ++k) {
      const Eigen::Vector3d arm_r = state.rMo.linear() * pointOf(view, corners[k]);
      const Eigen::Vector3d point_r = arm_r + state.rMo.translation();
      const Eigen::Vector3d point_e = fixed ? point_r : Eigen::Vector3d(view.lMr * point_r);
      const Eigen::Vector3d corrected_e = correction * point_e + shift;
      const Eigen::Vector3d point_l = fixed ? Eigen::Vector3d(view.lMr * corrected_e) : corrected_e;
      const Eigen::Vector3d arm_l = point_l - state.lMc.translation();
      const std::optional<Eigen::Vector2d> pixel = camera_.project(cRl * arm_l, derivative);
      if (!pixel) return std::nullopt;

      Eigen::Matrix2d weight = weights_[i][k] / scale_;
      const Eigen::Vector2d error = *pixel - corners[k].pixel;
      const double length = (weight * error).norm();
      if (length > options_.huber_sigma) {
        const double squares = options_.huber_sigma * length;
        robust_excess += options_.huber_sigma * (2.0 * length - options_.huber_sigma) - squares;
        weight *= std::sqrt(options_.huber_sigma / length);
      }
      const Eigen::Index row = 2 * static_cast<Eigen::Index>(k);
      residual.segment<2>(row) = weight * error;
      const Eigen::Matrix<double, 2, 3> by_l = weight * derivative.point * cRl;
      const Eigen::Matrix<double, 2, 3> by_r = by_l * l_by_r, by_e = by_l * l_by_e;
      jacobian.block<2, 3>(row, 0) = -by_l;
      jacobian.block<2, 3>(row, 3) = by_l * skew(arm_l);
      jacobian.block<2, 3>(row, 6) = by_r;
      jacobian.block<2, 3>(row, 9) = -by_r * skew(arm_r);
      jacobian.block<2, 3>(row, 12) = by_e;
      jacobian.block<2, 3>(row, 15) = -by_e * correction * skew(point_e) * turn_jacobian;
    }
    jacobian.bottomRows<6>().setZero();
    const Vector6d prior_root = std::sqrt(belief_[i]) * prior_root_;
    jacobian.bottomRightCorner<6, 6>() = prior_root.asDiagonal();
    residual.tail<6>() = prior_root.cwiseProduct(state.corrections[i]);
    system.add(static_cast<int>(i), jacobian, residual);
  }
  system.cost += robust_excess;
  return system;
}

HandEyeState HandEyeProblem::move(const HandEyeState& state, const ArrowStep& step) const {
  HandEyeState out{movedAboutOrigin(state.lMc, step.shared.head<6>()),
                   movedAboutOrigin(state.rMo, step.shared.tail<6>()), state.corrections};
  for (std::size_t i = 0; i < out.corrections.size(); ++i) out.corrections[i] += step.blocks[i];
  return out;
}

std::optional<ViewCost> HandEyeProblem::viewCost(const HandEyeState& state, const HandEyeStop& view,
                                                 const Vector6d& correction) const {
  ViewCost cost;
  cost.whitened = prior_root_.cwiseProduct(correction).squaredNorm();
  double squares_px2 = 0;
  const Eigen::Isometry3d cMo = boardPose(state, view, correction);
  for (const Corner& corner : view.detection->corners) {
    const std::optional<Eigen::Vector2d> pixel = camera_.project(cMo * pointOf(view, corner));
    if (!pixel) return std::nullopt;
    const Eigen::Vector2d error = *pixel - corner.pixel;
    const double length = (whitening(corner) * error).norm() / scale_;
    cost.whitened += length <= options_.huber_sigma
                         ? length * length
                         : options_.huber_sigma * (2.0 * length - options_.huber_sigma);
    squares_px2 += error.squaredNorm();
  }
  cost.rms_px = std::sqrt(squares_px2 / view.detection->corners.size());
  return cost;
}

Eigen::Isometry3d HandEyeProblem::boardPose(const HandEyeState& state, const HandEyeStop& view,
                                            const Vector6d& correction) const {
  Eigen::Isometry3d flange = Eigen::Isometry3d::Identity();
  flange.linear() = rotationExp(correction.tail<3>());
  flange.translation() = correction.head<3>();
  const Eigen::Isometry3d lMr = options_.mount == Mount::kFixed ? view.lMr * flange : flange * view.lMr;
  return state.lMc.inverse() * lMr * state.rMo;
}

}  // namespace servocal::calib
