// SPDX-License-Identifier: GPL-3.0-or-later
#include "depth_fit.h"

#include <Eigen/Dense>
#include <array>
#include <cmath>

#include "arrow.h"

namespace servocal::calib {
namespace {

bool isRange(const DepthModel& model) { return model.sensor == DepthSensor::kTimeOfFlight; }

/// Share of each node in the lattice at a pixel: the lattice is linear in its nodes.
Eigen::VectorXd nodeShares(DepthModel model, const Eigen::Vector2d& pixel) {
  Eigen::VectorXd shares(model.nodes.size());
  // Bilinear: four nodes are not zero, but this is not where the time goes.
  for (Eigen::Index k = 0; k < shares.size(); ++k) {
    model.nodes = Eigen::VectorXd::Unit(shares.size(), k);
    shares[k] = model.lattice(pixel);
  }
  return shares;
}

double logDeterminant(const Eigen::MatrixXd& matrix) {
  const Eigen::LLT<Eigen::MatrixXd> factor(matrix);
  return 2.0 * factor.matrixLLT().diagonal().array().abs().log().sum();
}

/// Nodes with a mean of zero over the image: orthonormal directions beside the integral's weights.
Eigen::MatrixXd zeroMeanBasis(const DepthModel& shape) {
  Eigen::VectorXd weights(shape.nodes.size());
  for (int row = 0; row < shape.nodes_y; ++row) {
    for (int column = 0; column < shape.nodes_x; ++column) {
      const double half_x = column == 0 || column == shape.nodes_x - 1 ? 0.5 : 1.0;
      const double half_y = row == 0 || row == shape.nodes_y - 1 ? 0.5 : 1.0;
      weights[row * shape.nodes_x + column] = half_x * half_y;
    }
  }
  const Eigen::MatrixXd q = Eigen::HouseholderQR<Eigen::MatrixXd>(weights).householderQ();
  return q.rightCols(weights.size() - 1);
}

/// Sum of squared differences of neighboring nodes, as a quadratic form.
Eigen::MatrixXd membrane(const DepthModel& shape) {
  Eigen::MatrixXd form = Eigen::MatrixXd::Zero(shape.nodes.size(), shape.nodes.size());
  const auto link = [&](int a, int b) {
    form(a, a) += 1.0, form(b, b) += 1.0;
    form(a, b) -= 1.0, form(b, a) -= 1.0;
  };
  for (int row = 0; row < shape.nodes_y; ++row) {
    for (int column = 0; column < shape.nodes_x; ++column) {
      const int at = row * shape.nodes_x + column;
      if (column + 1 < shape.nodes_x) link(at, at + 1);
      if (row + 1 < shape.nodes_y) link(at, at + shape.nodes_x);
    }
  }
  return form;
}

}  // namespace

struct DepthProblem::Normal {
  Eigen::MatrixXd matrix;
  Eigen::VectorXd right;
  double log_evidence_data = 0.0;  // what does not depend on the lattice's stiffness
};

double DepthProblem::linear(double depth_m, double stretch) const {
  return isRange(shape_) ? depth_m * stretch : 1.0 / depth_m;
}

DepthProblem::DepthProblem(DepthModel shape, bool free_slope, std::vector<DepthView> views)
    : shape_(std::move(shape)), free_slope_(free_slope), views_(std::move(views)) {
  shape_.nodes = Eigen::VectorXd::Zero(shape_.nodes_x * shape_.nodes_y);
  basis_ = zeroMeanBasis(shape_);
  roughness_ = basis_.transpose() * membrane(shape_) * basis_;
  roughness_log_determinant_ = logDeterminant(roughness_);
  double depth = 0.0, linear_sum = 0.0;
  int count = 0;
  for (const DepthView& view : views_) {
    for (Eigen::Index k = 0; k < view.raw_m.size(); ++k) {
      depth += view.raw_m[k];
      linear_sum += linear(view.raw_m[k], view.stretch[k]);
      ++count;
    }
  }
  middle_m_ = depth / count;
  middle_linear_ = linear_sum / count;
  for (const DepthView& view : views_) {
    const Eigen::Index patches = view.raw_m.size();
    Rows rows;
    rows.design.resize(patches, 2 + basis_.cols());
    rows.target.resize(patches);
    rows.to_linear.resize(patches);
    for (Eigen::Index k = 0; k < patches; ++k) {
      const double raw = linear(view.raw_m[k], view.stretch[k]);
      rows.to_linear[k] = isRange(shape_) ? view.stretch[k] : 1.0 / (view.plane_m[k] * view.plane_m[k]);
      rows.target[k] = linear(view.plane_m[k], view.stretch[k]) - raw;
      rows.design(k, 0) = 1.0;
      rows.design(k, 1) = free_slope_ ? raw - middle_linear_ : 0.0;
      rows.design.row(k).tail(basis_.cols()) =
          nodeShares(shape_, view.pixels[static_cast<std::size_t>(k)]).transpose() * basis_;
    }
    rows.plane_covariance =
        rows.to_linear.asDiagonal() * view.plane_covariance_m2 * rows.to_linear.asDiagonal();
    rows.patch_variance = view.raw_sigma_m.cwiseProduct(rows.to_linear).cwiseAbs2();
    rows_.push_back(std::move(rows));
  }
}

DepthProblem::Normal DepthProblem::normal(const DepthScales& scales) const {
  const Eigen::Index size = 2 + basis_.cols();
  Normal normal{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size), 0.0};
  for (const Rows& rows : rows_) {
    Eigen::MatrixXd covariance = rows.plane_covariance + scales.common_m * scales.common_m *
                                                             rows.to_linear * rows.to_linear.transpose();
    covariance.diagonal() += scales.patch * scales.patch * rows.patch_variance;
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
    const Eigen::MatrixXd design = factor.matrixL().solve(rows.design);
    const Eigen::VectorXd target = factor.matrixL().solve(rows.target);
    normal.matrix += design.transpose() * design;
    normal.right += design.transpose() * target;
    normal.log_evidence_data -=
        factor.matrixLLT().diagonal().array().abs().log().sum() + 0.5 * target.squaredNorm();
  }
  if (!free_slope_) normal.matrix(1, 1) = 1.0;
  return normal;
}

DepthFit DepthProblem::solveAt(const DepthScales& scales) const {
  Normal equations = normal(scales);
  const double to_linear = isRange(shape_) ? 1.0 : 1.0 / (middle_m_ * middle_m_);
  const double stiffness = 1.0 / std::pow(scales.lattice_m * to_linear, 2);
  const Eigen::Index free = basis_.cols();
  equations.matrix.bottomRightCorner(free, free) += stiffness * roughness_;
  const Eigen::MatrixXd inverse = scaledInverse(equations.matrix);
  const Eigen::VectorXd solution = inverse * equations.right;

  DepthFit fit;
  fit.scales = scales;
  // Scaled to unit diagonal for its determinant.
  const Eigen::VectorXd scale = equations.matrix.diagonal().cwiseSqrt();
  const Eigen::MatrixXd unit = scale.cwiseInverse().asDiagonal() * equations.matrix * scale.cwiseInverse().asDiagonal();
  fit.log_evidence = equations.log_evidence_data + 0.5 * solution.dot(equations.right) -
                     0.5 * (logDeterminant(unit) + 2.0 * scale.array().log().sum()) +
                     0.5 * (static_cast<double>(free) * std::log(stiffness) + roughness_log_determinant_);

  // From (value at the middle, slope - 1, free combinations) to (offset, slope, nodes).
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(2 + shape_.nodes.size(), 2 + free);
  map(0, 0) = 1.0;
  if (free_slope_) map(0, 1) = -middle_linear_, map(1, 1) = 1.0;
  map.bottomRightCorner(shape_.nodes.size(), free) = basis_;
  const Eigen::VectorXd parameters = map * solution;
  fit.covariance = map * inverse * map.transpose();
  fit.model = shape_;
  fit.model.offset = parameters[0];
  fit.model.slope = 1.0 + parameters[1];
  fit.model.nodes = parameters.tail(shape_.nodes.size());
  for (const Rows& rows : rows_) {
    fit.residual_m.push_back((rows.target - rows.design * solution).cwiseQuotient(rows.to_linear));
    if (!isRange(shape_)) fit.residual_m.back() *= -1.0;  // nearer is larger
  }
  return fit;
}

DepthFit DepthProblem::solve(const DepthScales& start) const {
  // Coordinate search on the logarithms; the evidence is smooth and has one top in practice.
  constexpr std::array<double DepthScales::*, 3> kScales = {&DepthScales::patch, &DepthScales::common_m,
                                                            &DepthScales::lattice_m};
  constexpr std::array<double, 3> kLeast = {1e-3, 1e-7, 1e-6}, kMost = {30.0, 0.05, 0.1};
  DepthFit best = solveAt(start);
  for (double factor : {4.0, 2.0, 1.4, 1.2}) {
    for (int round = 0; round < 6; ++round) {
      bool moved = false;
      for (std::size_t i = 0; i < kScales.size(); ++i) {
        for (const double step : {factor, 1.0 / factor}) {
          for (int repeat = 0; repeat < 12; ++repeat) {
            DepthScales trial = best.scales;
            trial.*kScales[i] = std::clamp(trial.*kScales[i] * step, kLeast[i], kMost[i]);
            DepthFit fit = solveAt(trial);
            if (!(fit.log_evidence > best.log_evidence + 1e-6)) break;
            best = std::move(fit);
            moved = true;
          }
        }
      }
      if (!moved) break;
    }
  }
  return best;
}

Eigen::VectorXd DepthProblem::gradient(const DepthModel& model, const Eigen::Vector2d& pixel, double raw_m) const {
  const auto ray = model.camera.unproject(pixel);
  const double stretch = ray ? std::sqrt(1.0 + ray->squaredNorm()) : 1.0;
  const double depth = model.correct(pixel, raw_m).value_or(raw_m);
  Eigen::VectorXd gradient(2 + model.nodes.size());
  gradient << 1.0, linear(raw_m, stretch), nodeShares(model, pixel);
  return gradient * (isRange(model) ? 1.0 / stretch : -depth * depth);
}

Eigen::MatrixXd DepthProblem::covarianceAt(const DepthFit& fit, const DepthView& view) const {
  Eigen::MatrixXd gradients(view.raw_m.size(), fit.covariance.rows());
  for (Eigen::Index k = 0; k < view.raw_m.size(); ++k)
    gradients.row(k) = gradient(fit.model, view.pixels[static_cast<std::size_t>(k)], view.raw_m[k]).transpose();
  return gradients * fit.covariance * gradients.transpose();
}

}  // namespace servocal::calib
