// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_problem.h"

#include <algorithm>
#include <stdexcept>

#include "corner_weight.h"

namespace servocal::calib {
namespace {

std::vector<int> freeOf(const JointStream& stream) {
  const std::vector<std::string>& names = parameterNames(stream.lens);
  for (const std::string& name : stream.fixed) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw std::invalid_argument("no intrinsic parameter is called '" + name + "'");
    }
  }
  std::vector<int> free;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (std::find(stream.fixed.begin(), stream.fixed.end(), names[i]) == stream.fixed.end()) {
      free.push_back(static_cast<int>(i));
    }
  }
  return free;
}

/// The pose after a displacement of its origin and a turn about it, along the axes of the left frame.
Eigen::Isometry3d movedAboutOrigin(const Eigen::Isometry3d& pose, const Eigen::Ref<const Vector6d>& step) {
  Eigen::Isometry3d out = pose;
  out.linear() = rotationExp(step.tail<3>()) * pose.linear();
  out.translation() += step.head<3>();
  return out;
}

JointLayout layoutOf(const JointOptions& options) {
  JointLayout layout;
  int at = 0;
  for (const JointStream& stream : options.streams) {
    layout.cameras.push_back({freeOf(stream), at});
    at += layout.cameras.back().size();
  }
  layout.board_at = at;
  layout.shape_at = at + 6;
  layout.scale = options.board.scale;
  layout.bow = options.board.bow;
  layout.terms_at = layout.shape_at + layout.shapeSize();
  layout.size =
      layout.terms_at + (options.robot_terms ? static_cast<int>(options.robot_terms->names.size()) : 0);
  return layout;
}

}  // namespace

JointProblem::JointProblem(const BoardSpec& board, const JointOptions& options, std::vector<JointStop> stops)
    : options_(options), points_o_(board.corners()), turns_(board), stops_(std::move(stops)),
      layout_(layoutOf(options)) {
  half_size_m_.setConstant(1e-9);
  for (const Eigen::Vector3d& point : points_o_)
    half_size_m_ = half_size_m_.cwiseMax(point.head<2>().cwiseAbs());
  noise_ = {options.robot_sigma_m, options.robot_sigma_rad, std::vector<double>(options.streams.size(), 1.0)};
}

Eigen::VectorXd JointProblem::scales(const JointState& state) const {
  constexpr double kPositionM = 0.1, kTurnRad = 0.2;
  Vector6d pose;
  pose << Eigen::Vector3d::Constant(kPositionM), Eigen::Vector3d::Constant(kTurnRad);
  Eigen::VectorXd out(layout_.size);
  for (std::size_t k = 0; k < layout_.cameras.size(); ++k) {
    const JointLayout::Camera& camera = layout_.cameras[k];
    const Eigen::MatrixXd& covariance = options_.streams[k].prior
                                            ? options_.streams[k].prior->covariance
                                            : nominalPrior(state.cameras[k].model).covariance;
    for (std::size_t p = 0; p < camera.free.size(); ++p) {
      out[camera.at + static_cast<int>(p)] = std::sqrt(covariance(camera.free[p], camera.free[p]));
    }
    out.segment<6>(camera.poseAt()) = pose;
  }
  out.segment<6>(layout_.board_at) = pose;
  int at = layout_.shape_at;
  for (int i = 0; layout_.scale && i < 2; ++i) out[at++] = options_.board.scale_sigma;
  for (int i = 0; layout_.bow && i < 2; ++i) out[at++] = options_.board.bow_sigma_m;
  if (options_.robot_terms) out.tail(layout_.size - layout_.terms_at) = options_.robot_terms->prior_sigma;
  return out;
}

std::vector<std::string> JointProblem::names() const {
  static const std::vector<std::string> pose = {"x", "y", "z", "turn x", "turn y", "turn z"};
  std::vector<std::string> out;
  for (std::size_t k = 0; k < layout_.cameras.size(); ++k) {
    const JointStream& stream = options_.streams[k];
    const std::string camera = stream.camera + " " + toString(stream.stream) + " ";
    for (const int p : layout_.cameras[k].free) {
      out.push_back(camera + parameterNames(stream.lens)[static_cast<std::size_t>(p)]);
    }
    for (const std::string& name : pose) out.push_back(camera + name);
  }
  for (const std::string& name : pose) out.push_back("board " + name);
  if (layout_.scale) out.insert(out.end(), {"board scale x", "board scale y"});
  if (layout_.bow) out.insert(out.end(), {"board bow x", "board bow y"});
  if (options_.robot_terms) {
    out.insert(out.end(), options_.robot_terms->names.begin(), options_.robot_terms->names.end());
  }
  return out;
}

Eigen::Vector3d JointProblem::point(const JointState& state, int id, int turn) const {
  const Eigen::Vector3d& point = points_o_[static_cast<std::size_t>(turns_.id(id, turn))];
  const Eigen::Vector2d share = point.head<2>().cwiseQuotient(half_size_m_);
  return {state.shape.scale_x * point.x(), state.shape.scale_y * point.y(),
          state.shape.bow_x_m * (1.0 - share.x() * share.x()) +
              state.shape.bow_y_m * (1.0 - share.y() * share.y())};
}

Vector6d JointProblem::correction(const JointState& state, std::size_t stop) const {
  if (state.terms.size() == 0) return state.corrections[stop];
  return state.corrections[stop] + stops_[stop].by_terms * state.terms;
}

Eigen::Isometry3d JointProblem::boardPose(const JointState& state, const JointView& view,
                                          const Vector6d& correction) const {
  Eigen::Isometry3d flange = Eigen::Isometry3d::Identity();
  flange.linear() = rotationExp(correction.tail<3>());
  flange.translation() = correction.head<3>();
  const Eigen::Isometry3d bMe = stops_[view.stop].bMe * flange;
  const Eigen::Isometry3d lMr = options_.mount == Mount::kFixed ? bMe : bMe.inverse();
  return state.cameras[view.camera].lMc.inverse() * lMr * state.rMo;
}

std::optional<JointResidual> JointProblem::residual(const JointState& state, const JointView& view) const {
  const JointLayout::Camera& layout = layout_.cameras[view.camera];
  const JointState::Camera& camera = state.cameras[view.camera];
  const std::vector<Corner>& corners = view.detection->corners;
  const Eigen::Index free = static_cast<Eigen::Index>(layout.free.size());
  const Eigen::Index shape_at = free + 12, stop_at = shape_at + layout_.shapeSize();
  JointResidual out;
  out.jacobian.resize(2 * static_cast<Eigen::Index>(corners.size()), stop_at + 6);
  out.residual.resize(out.jacobian.rows());

  const Vector6d correction = this->correction(state, view.stop);
  const Eigen::Vector3d shift = correction.head<3>(), turn = correction.tail<3>();
  const Eigen::Matrix3d turned = rotationExp(turn), turn_jacobian = rightJacobian(turn);
  const Eigen::Isometry3d& bMe = stops_[view.stop].bMe;
  const bool fixed = options_.mount == Mount::kFixed;
  const Eigen::Isometry3d eMb = bMe.inverse();
  // Flange: p_e = C^-1 eMb p_b.
  const Eigen::Matrix3d lRr =
      fixed ? Eigen::Matrix3d(bMe.linear() * turned) : Eigen::Matrix3d(turned.transpose() * eMb.linear());
  const Eigen::Matrix3d cRl = camera.lMc.linear().transpose();
  const double inverse_scale = 1.0 / noise_.corner_scale[view.camera];
  ProjectionJacobian derivative;
  for (std::size_t j = 0; j < corners.size(); ++j) {
    const Eigen::Vector3d& nominal = points_o_[static_cast<std::size_t>(turns_.id(corners[j].id, view.turn))];
    const Eigen::Vector3d arm_r = state.rMo.linear() * point(state, corners[j].id, view.turn);
    const Eigen::Vector3d point_r = arm_r + state.rMo.translation();
    const Eigen::Vector3d point_l = fixed ? Eigen::Vector3d(bMe * (turned * point_r + shift))
                                          : Eigen::Vector3d(turned.transpose() * (eMb * point_r - shift));
    const Eigen::Vector3d arm_l = point_l - camera.lMc.translation();
    const std::optional<Eigen::Vector2d> pixel = camera.model.project(cRl * arm_l, derivative);
    if (!pixel) return std::nullopt;

    Eigen::Matrix2d weight = view.weights[j] * inverse_scale;
    const Eigen::Vector2d error = *pixel - corners[j].pixel;
    const double length = (weight * error).norm();
    if (length > options_.huber_sigma) {
      const double squares = options_.huber_sigma * length;
      out.robust_excess += options_.huber_sigma * (2.0 * length - options_.huber_sigma) - squares;
      weight *= std::sqrt(options_.huber_sigma / length);
    }
    const Eigen::Index row = 2 * static_cast<Eigen::Index>(j);
    out.residual.segment<2>(row) = weight * error;
    for (Eigen::Index p = 0; p < free; ++p) {
      out.jacobian.block<2, 1>(row, p) =
          weight * derivative.parameters.col(layout.free[static_cast<std::size_t>(p)]);
    }
    const Eigen::Matrix<double, 2, 3> by_l = weight * derivative.point * cRl, by_r = by_l * lRr;
    out.jacobian.block<2, 3>(row, free) = -by_l;
    out.jacobian.block<2, 3>(row, free + 3) = by_l * skew(arm_l);
    out.jacobian.block<2, 3>(row, free + 6) = by_r;
    out.jacobian.block<2, 3>(row, free + 9) = -by_r * skew(arm_r);
    const Eigen::Matrix<double, 2, 3> by_o = by_r * state.rMo.linear();
    Eigen::Index at = shape_at;
    if (layout_.scale) {
      out.jacobian.block<2, 1>(row, at) = by_o.col(0) * nominal.x();
      out.jacobian.block<2, 1>(row, at + 1) = by_o.col(1) * nominal.y();
      at += 2;
    }
    if (layout_.bow) {
      const Eigen::Vector2d share = nominal.head<2>().cwiseQuotient(half_size_m_);
      out.jacobian.block<2, 1>(row, at) = by_o.col(2) * (1.0 - share.x() * share.x());
      out.jacobian.block<2, 1>(row, at + 1) = by_o.col(2) * (1.0 - share.y() * share.y());
    }
    if (fixed) {
      out.jacobian.block<2, 3>(row, stop_at) = by_l * bMe.linear();
      out.jacobian.block<2, 3>(row, stop_at + 3) = -by_r * skew(point_r) * turn_jacobian;
    } else {
      out.jacobian.block<2, 3>(row, stop_at) = -by_l * turned.transpose();
      out.jacobian.block<2, 3>(row, stop_at + 3) = by_l * skew(point_l) * turn_jacobian;
    }
  }
  return out;
}

void JointProblem::addPriors(const JointState& state, ArrowSystem& system) const {
  for (std::size_t k = 0; k < layout_.cameras.size(); ++k) {
    const std::optional<IntrinsicsPrior>& prior = options_.streams[k].prior;
    if (!prior) continue;
    const std::vector<int>& free = layout_.cameras[k].free;
    const Eigen::Index count = static_cast<Eigen::Index>(free.size()), at = layout_.cameras[k].at;
    Eigen::MatrixXd covariance(count, count);
    Eigen::VectorXd offset(count);
    for (Eigen::Index i = 0; i < count; ++i) {
      const int p = free[static_cast<std::size_t>(i)];
      offset[i] = state.cameras[k].model.parameters[p] - prior->camera.parameters[p];
      for (Eigen::Index j = 0; j < count; ++j)
        covariance(i, j) = prior->covariance(p, free[static_cast<std::size_t>(j)]);
    }
    const Eigen::MatrixXd information = scaledInverse(covariance);
    system.matrix.block(at, at, count, count) += information;
    system.gradient.segment(at, count) += information * offset;
    system.cost += offset.dot(information * offset);
  }
  const auto add = [&](int at, double offset, double sigma) {
    const double information = 1.0 / (sigma * sigma);
    system.matrix(at, at) += information;
    system.gradient[at] += information * offset;
    system.cost += information * offset * offset;
  };
  int at = layout_.shape_at;
  if (layout_.scale) {
    add(at++, state.shape.scale_x - 1.0, options_.board.scale_sigma);
    add(at++, state.shape.scale_y - 1.0, options_.board.scale_sigma);
  }
  if (layout_.bow) {
    add(at++, state.shape.bow_x_m, options_.board.bow_sigma_m);
    add(at++, state.shape.bow_y_m, options_.board.bow_sigma_m);
  }
  for (Eigen::Index i = 0; i < state.terms.size(); ++i) {
    add(layout_.terms_at + static_cast<int>(i), state.terms[i],
        noise_.terms_scale * options_.robot_terms->prior_sigma[i]);
  }
  constexpr double kAnchor = 1e-3;
  system.matrix.diagonal() += kAnchor * scales(state).cwiseAbs2().cwiseInverse();
}

bool JointProblem::addView(const JointState& state, const JointView& view, std::size_t block,
                           ArrowSystem& system) const {
  const std::optional<JointResidual> seen = residual(state, view);
  if (!seen) return false;
  const JointLayout::Camera& camera = layout_.cameras[view.camera];
  const int common = 6 + layout_.shapeSize(), board_at = layout_.board_at, own = camera.size(),
            size = own + common;
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(size + 6, size + 6);
  matrix.selfadjointView<Eigen::Lower>().rankUpdate(seen->jacobian.transpose());
  matrix.triangularView<Eigen::StrictlyUpper>() = matrix.transpose();
  const Eigen::VectorXd gradient = seen->jacobian.transpose() * seen->residual;
  system.cost += seen->residual.squaredNorm() + seen->robust_excess;

  system.matrix.block(camera.at, camera.at, own, own) += matrix.topLeftCorner(own, own);
  system.matrix.block(camera.at, board_at, own, common) += matrix.block(0, own, own, common);
  system.matrix.block(board_at, camera.at, common, own) += matrix.block(own, 0, common, own);
  system.matrix.block(board_at, board_at, common, common) += matrix.block(own, own, common, common);
  system.gradient.segment(camera.at, own) += gradient.head(own);
  system.gradient.segment(board_at, common) += gradient.segment(own, common);
  ArrowSystem::Block& stop = system.blocks[block];
  stop.matrix += matrix.bottomRightCorner<6, 6>();
  stop.gradient += gradient.tail<6>();
  stop.cross.middleRows(camera.at, own) += matrix.block(0, size, own, 6);
  stop.cross.middleRows(board_at, common) += matrix.block(own, size, common, 6);
  return true;
}

void JointProblem::finishStop(const JointState& state, std::size_t stop, std::size_t block,
                              ArrowSystem& system) const {
  const Eigen::Index terms = state.terms.size(), at = layout_.terms_at;
  ArrowSystem::Block& own = system.blocks[block];
  if (terms > 0) {
    // A systematic error acts through the correction of the stop.
    const Eigen::MatrixXd& by_terms = stops_[stop].by_terms;
    const Eigen::MatrixXd cross = own.cross.topRows(at) * by_terms;
    system.matrix.block(0, at, at, terms) += cross;
    system.matrix.block(at, 0, terms, at) += cross.transpose();
    system.matrix.block(at, at, terms, terms) += by_terms.transpose() * own.matrix * by_terms;
    system.gradient.segment(at, terms) += by_terms.transpose() * own.gradient;
    own.cross.middleRows(at, terms) = by_terms.transpose() * own.matrix;
  }
  Vector6d information;
  information << Eigen::Vector3d::Constant(1.0 / (noise_.robot_m * noise_.robot_m)),
      Eigen::Vector3d::Constant(1.0 / (noise_.robot_rad * noise_.robot_rad));
  own.matrix.diagonal() += information;
  own.gradient += information.cwiseProduct(state.corrections[stop]);
  system.cost += state.corrections[stop].dot(information.cwiseProduct(state.corrections[stop]));
}

std::optional<ArrowSystem> JointProblem::linearize(const JointState& state) const {
  ArrowSystem system(layout_.size, static_cast<int>(stops_.size()));
  for (const JointView& view : views_) {
    if (!addView(state, view, view.stop, system)) return std::nullopt;
  }
  for (std::size_t i = 0; i < stops_.size(); ++i) finishStop(state, i, i, system);
  addPriors(state, system);
  return system;
}

std::optional<ArrowSystem> JointProblem::linearizeStop(const JointState& state, std::size_t stop) const {
  ArrowSystem system(layout_.size, 1);
  for (const JointView& view : views_) {
    if (view.stop == stop && !addView(state, view, 0, system)) return std::nullopt;
  }
  finishStop(state, stop, 0, system);
  return system;
}

JointState JointProblem::move(const JointState& state, const ArrowStep& step) const {
  JointState out = state;
  for (std::size_t k = 0; k < out.cameras.size(); ++k) {
    const JointLayout::Camera& camera = layout_.cameras[k];
    for (std::size_t p = 0; p < camera.free.size(); ++p) {
      out.cameras[k].model.parameters[camera.free[p]] += step.shared[camera.at + static_cast<int>(p)];
    }
    out.cameras[k].lMc = movedAboutOrigin(state.cameras[k].lMc, step.shared.segment<6>(camera.poseAt()));
  }
  out.rMo = movedAboutOrigin(state.rMo, step.shared.segment<6>(layout_.board_at));
  int at = layout_.shape_at;
  if (layout_.scale) {
    out.shape.scale_x += step.shared[at++];
    out.shape.scale_y += step.shared[at++];
  }
  if (layout_.bow) {
    out.shape.bow_x_m += step.shared[at++];
    out.shape.bow_y_m += step.shared[at++];
  }
  out.terms += step.shared.tail(layout_.size - layout_.terms_at);
  for (std::size_t i = 0; i < out.corrections.size(); ++i) out.corrections[i] += step.blocks[i];
  return out;
}

}  // namespace servocal::calib
