// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_noise.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "median.h"

namespace servocal::calib {
namespace {

/// Mean of the weighted squares of a Gaussian 2-vector of unit variance per axis under Huber's weights, over
/// its two degrees of freedom: the factor by which the robust sum of squares is too small.
double huberShare(double h) {
  const double tail = std::exp(-0.5 * h * h);
  const double beyond = h * tail + std::sqrt(M_PI / 2.0) * std::erfc(h / std::sqrt(2.0));  // E[r; r > h]
  return 0.5 * (2.0 - tail * (h * h + 2.0) + h * beyond);
}

}  // namespace

JointCovariance::JointCovariance(const ArrowSystem& system) : shared_(scaledInverse(reducedMatrix(system))) {
  for (const ArrowSystem::Block& block : system.blocks) {
    inverses_.push_back(scaledInverse(block.matrix));
    gains_.emplace_back(block.cross * inverses_.back());
  }
}

Matrix6d JointCovariance::ofStop(std::size_t stop) const {
  return inverses_[stop] + gains_[stop].transpose() * shared_ * gains_[stop];
}

Eigen::MatrixXd JointCovariance::crossOf(std::size_t stop) const { return -shared_ * gains_[stop]; }

NoiseEstimate varianceComponents(const JointProblem& problem, const JointState& state,
                                 const ArrowSystem& system) {
  const JointCovariance covariance(system);
  const JointLayout& layout = problem.layout();
  const JointNoise& noise = problem.noise();
  const Eigen::Index terms = layout.size - layout.terms_at, common = 6 + layout.shapeSize();

  NoiseEstimate out{noise, 0.0, 0.0, {}};
  double squares_m2 = 0, squares_rad2 = 0;
  std::vector<double> squares(layout.cameras.size(), 0.0), degrees(layout.cameras.size(), 0.0);
  std::size_t at_view = 0;
  for (std::size_t i = 0; i < problem.stops().size(); ++i) {
    const Matrix6d own = covariance.ofStop(i);
    squares_m2 += state.corrections[i].head<3>().squaredNorm();
    squares_rad2 += state.corrections[i].tail<3>().squaredNorm();
    out.degrees_m += 3.0 - own.topLeftCorner<3, 3>().trace() / (noise.robot_m * noise.robot_m);
    out.degrees_rad += 3.0 - own.bottomRightCorner<3, 3>().trace() / (noise.robot_rad * noise.robot_rad);

    // The whole correction: that of the stop and the systematic part.
    Eigen::MatrixXd cross = covariance.crossOf(i);
    Matrix6d whole = own;
    if (terms > 0) {
      const Eigen::MatrixXd& by_terms = problem.stops()[i].by_terms;
      const Eigen::MatrixXd with_own = by_terms * cross.bottomRows(terms);
      whole += with_own + with_own.transpose() +
               by_terms * covariance.shared().bottomRightCorner(terms, terms) * by_terms.transpose();
      cross += covariance.shared().rightCols(terms) * by_terms.transpose();
    }
    for (; at_view < problem.views().size() && problem.views()[at_view].stop == i; ++at_view) {
      const JointView& view = problem.views()[at_view];
      const auto seen = problem.residual(state, view);
      if (!seen) continue;
      const JointLayout::Camera& camera = layout.cameras[view.camera];
      const Eigen::Index size = camera.size();
      Eigen::MatrixXd local(size + common + 6, size + common + 6);
      local.topLeftCorner(size, size) = covariance.shared().block(camera.at, camera.at, size, size);
      local.block(0, size, size, common) =
          covariance.shared().block(camera.at, layout.board_at, size, common);
      local.block(size, 0, common, size) = local.block(0, size, size, common).transpose();
      local.block(size, size, common, common) =
          covariance.shared().block(layout.board_at, layout.board_at, common, common);
      local.topRightCorner(size, 6) = cross.middleRows(camera.at, size);
      local.block(size, size + common, common, 6) = cross.middleRows(layout.board_at, common);
      local.bottomLeftCorner(6, size + common) = local.topRightCorner(size + common, 6).transpose();
      local.bottomRightCorner<6, 6>() = whole;
      squares[view.camera] += seen->residual.squaredNorm();
      degrees[view.camera] += static_cast<double>(seen->residual.size()) -
                              (seen->jacobian * local).cwiseProduct(seen->jacobian).sum();
    }
  }
  const auto sigma = [](double sum, double of, double declared) {
    return of >= kLeastDegrees ? std::max(kLeastRobotSigma, std::sqrt(sum / of)) : declared;
  };
  out.noise.robot_m = sigma(squares_m2, out.degrees_m, problem.options().robot_sigma_m);
  out.noise.robot_rad = sigma(squares_rad2, out.degrees_rad, problem.options().robot_sigma_rad);
  if (terms > 0) {
    const Eigen::VectorXd& declared = problem.options().robot_terms->prior_sigma;
    const double known =
        covariance.shared().diagonal().tail(terms).cwiseQuotient(declared.cwiseAbs2()).sum() /
        (noise.terms_scale * noise.terms_scale);
    const double speaking = std::max(0.0, static_cast<double>(terms) - known);
    out.noise.terms_scale = std::sqrt((state.terms.cwiseQuotient(declared).squaredNorm() + kLeastDegrees) /
                                      (speaking + kLeastDegrees));
  }
  const double share = huberShare(problem.options().huber_sigma);
  for (std::size_t k = 0; k < layout.cameras.size(); ++k) {
    const double ratio = degrees[k] >= kLeastDegrees ? squares[k] / (share * degrees[k]) : 1.0;
    out.chi_square.push_back(ratio * noise.corner_scale[k] * noise.corner_scale[k]);
    out.noise.corner_scale[k] = std::max(kLeastCornerScale, std::sqrt(out.chi_square[k]));
  }
  return out;
}

std::vector<double> typicalCornerScales(const JointProblem& problem, const JointState& state) {
  std::vector<std::vector<double>> by_camera(problem.layout().cameras.size());
  for (const JointView& view : problem.views()) {
    const auto seen = problem.residual(state, view);
    if (!seen) continue;
    const double robust = seen->residual.squaredNorm() + seen->robust_excess;
    by_camera[view.camera].push_back(std::sqrt(robust / static_cast<double>(seen->residual.size())));
  }
  std::vector<double> out;
  for (std::size_t k = 0; k < by_camera.size(); ++k) {
    const double typical = by_camera[k].empty() ? 1.0 : median(by_camera[k]);
    out.push_back(std::max(kLeastCornerScale, problem.noise().corner_scale[k] * typical));
  }
  return out;
}

}  // namespace servocal::calib
