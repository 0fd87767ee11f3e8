// SPDX-License-Identifier: GPL-3.0-or-later
#include "depth_fit.h"

#include <Eigen/Dense>
#include <array>
#include <cmath>

#include "arrow.h"

namespace servocal::calib {
namespace {

/// How far the slope of a time-of-flight sensor is off 1: its clock is a crystal. Without that a long harmonic of the
/// wiggle and the slope are not told apart over half a metre.
constexpr double kSlopeSigma = 0.003;

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

/// Share of each node in the wiggling error at a raw range.
Eigen::VectorXd wiggleShares(DepthModel model, double range_m) {
  Eigen::VectorXd shares(model.wiggle.size());
  for (Eigen::Index k = 0; k < shares.size(); ++k) {
    model.wiggle = Eigen::VectorXd::Unit(shares.size(), k);
    shares[k] = model.wiggling(range_m);
  }
  return shares;
}

/// Correlation of the wiggle's nodes: a stationary process, so that it fades where no board was. Matern's of order 3/2
/// (Rasmussen, Williams, "Gaussian Processes for Machine Learning", 4.17), as smooth as a sine of half a metre, the
/// shorter of the harmonics that modulated light has.
Eigen::MatrixXd wiggleCorrelation(const DepthModel& shape) {
  constexpr double kLengthM = 0.13;
  const Eigen::Index count = shape.wiggle.size();
  const double step_m = count > 1 ? (shape.wiggle_to_m - shape.wiggle_from_m) / static_cast<double>(count - 1) : 0.0;
  Eigen::MatrixXd correlation(count, count);
  for (Eigen::Index a = 0; a < count; ++a) {
    for (Eigen::Index b = 0; b < count; ++b) {
      const double apart = std::sqrt(3.0) * static_cast<double>(std::abs(a - b)) * step_m / kLengthM;
      correlation(a, b) = (1.0 + apart) * std::exp(-apart);
    }
  }
  return correlation;
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

/// All rows in units of their standard deviations, and the matrix of their normal equations.
struct DepthProblem::Normal {
  Eigen::MatrixXd design, matrix;
  Eigen::VectorXd target;
  double log_determinant = 0.0;  // of the rows' covariance, half and negative
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
  const Eigen::Index wiggles = shape_.wiggle.size();
  if (wiggles > 0) {
    wiggle_precision_ = wiggleCorrelation(shape_).llt().solve(Eigen::MatrixXd::Identity(wiggles, wiggles));
    wiggle_log_determinant_ = logDeterminant(wiggle_precision_);
  }
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
    rows.design.resize(patches, 2 + wiggles + basis_.cols());
    rows.target.resize(patches);
    rows.to_linear.resize(patches);
    for (Eigen::Index k = 0; k < patches; ++k) {
      const double raw = linear(view.raw_m[k], view.stretch[k]);
      rows.to_linear[k] = isRange(shape_) ? view.stretch[k] : 1.0 / (view.plane_m[k] * view.plane_m[k]);
      rows.target[k] = linear(view.plane_m[k], view.stretch[k]) - raw;
      rows.design(k, 0) = 1.0;
      rows.design(k, 1) = free_slope_ ? raw - middle_linear_ : 0.0;
      rows.design.row(k).segment(2, wiggles) = wiggleShares(shape_, raw).transpose();
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
  Eigen::Index count = 0;
  for (const Rows& rows : rows_) count += rows.target.size();
  Normal normal;
  normal.design.resize(count, 2 + shape_.wiggle.size() + basis_.cols());
  normal.target.resize(count);
  Eigen::Index at = 0;
  for (const Rows& rows : rows_) {
    const Eigen::Index patches = rows.target.size();
    Eigen::MatrixXd covariance = rows.plane_covariance + scales.common_m * scales.common_m *
                                                             rows.to_linear * rows.to_linear.transpose();
    covariance.diagonal() += scales.patch * scales.patch * rows.patch_variance;
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
    normal.design.middleRows(at, patches) = factor.matrixL().solve(rows.design);
    normal.target.segment(at, patches) = factor.matrixL().solve(rows.target);
    normal.log_determinant -= factor.matrixLLT().diagonal().array().abs().log().sum();
    at += patches;
  }
  normal.matrix = normal.design.transpose() * normal.design;
  if (!free_slope_) {
    normal.matrix(1, 1) = 1.0;
  } else if (isRange(shape_)) {
    normal.matrix(1, 1) += 1.0 / (kSlopeSigma * kSlopeSigma);
  }
  return normal;
}

DepthFit DepthProblem::solveAt(const DepthScales& scales) const {
  Normal equations = normal(scales);
  const double to_linear = isRange(shape_) ? 1.0 : 1.0 / (middle_m_ * middle_m_);
  const double stiffness = 1.0 / std::pow(scales.lattice_m * to_linear, 2);
  const Eigen::Index free = basis_.cols(), wiggles = shape_.wiggle.size();
  equations.matrix.bottomRightCorner(free, free) += stiffness * roughness_;
  const double wiggle_weight = 1.0 / (scales.wiggle_m * scales.wiggle_m);
  equations.matrix.block(2, 2, wiggles, wiggles) += wiggle_weight * wiggle_precision_;
  const Eigen::MatrixXd inverse = scaledInverse(equations.matrix);
  const Eigen::VectorXd solution = inverse * (equations.design.transpose() * equations.target);

  DepthFit fit;
  fit.scales = scales;
  // Scaled to unit diagonal for its determinant.
  const Eigen::VectorXd scale = equations.matrix.diagonal().cwiseSqrt();
  const Eigen::MatrixXd unit = scale.cwiseInverse().asDiagonal() * equations.matrix * scale.cwiseInverse().asDiagonal();
  // By the residuals: the difference of two sums of squares would be lost in rounding where data are good.
  const auto lattice = solution.tail(free), wiggle = solution.segment(2, wiggles);
  const double slope_misfit = free_slope_ && isRange(shape_) ? std::pow(solution[1] / kSlopeSigma, 2) : 0.0;
  const double misfit = slope_misfit + (equations.target - equations.design * solution).squaredNorm() +
                        stiffness * lattice.dot(roughness_ * lattice) +
                        (wiggles > 0 ? wiggle_weight * wiggle.dot(wiggle_precision_ * wiggle) : 0.0);
  fit.log_evidence = equations.log_determinant - 0.5 * misfit -
                     0.5 * (logDeterminant(unit) + 2.0 * scale.array().log().sum()) +
                     0.5 * (static_cast<double>(free) * std::log(stiffness) + roughness_log_determinant_) +
                     0.5 * (static_cast<double>(wiggles) * std::log(wiggle_weight) + wiggle_log_determinant_);

  // From (value at the middle, slope - 1, wiggle, free combinations) to (offset, slope, wiggle, nodes).
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(2 + wiggles + shape_.nodes.size(), 2 + wiggles + free);
  map(0, 0) = 1.0;
  if (free_slope_) map(0, 1) = -middle_linear_, map(1, 1) = 1.0;
  map.block(2, 2, wiggles, wiggles).setIdentity();
  map.bottomRightCorner(shape_.nodes.size(), free) = basis_;
  const Eigen::VectorXd parameters = map * solution;
  fit.covariance = map * inverse * map.transpose();
  fit.model = shape_;
  fit.model.offset = parameters[0];
  fit.model.slope = 1.0 + parameters[1];
  fit.model.wiggle = parameters.segment(2, wiggles);
  fit.model.nodes = parameters.tail(shape_.nodes.size());
  for (const Rows& rows : rows_) {
    fit.residual_m.push_back((rows.target - rows.design * solution).cwiseQuotient(rows.to_linear));
    if (!isRange(shape_)) fit.residual_m.back() *= -1.0;  // nearer is larger
  }
  return fit;
}

DepthFit DepthProblem::solve(const DepthScales& start) const {
  // Coordinate search on the logarithms; the evidence is smooth and has one top in practice.
  constexpr std::array<double DepthScales::*, 4> kScales = {&DepthScales::patch, &DepthScales::common_m,
                                                            &DepthScales::lattice_m, &DepthScales::wiggle_m};
  constexpr std::array<double, 4> kLeast = {1e-3, 1e-7, 1e-6, 1e-6}, kMost = {30.0, 0.05, 0.1, 0.05};
  const std::size_t searched = shape_.wiggle.size() > 0 ? kScales.size() : kScales.size() - 1;
  DepthFit best = solveAt(start);
  for (double factor : {4.0, 2.0, 1.4, 1.2}) {
    for (int round = 0; round < 6; ++round) {
      bool moved = false;
      for (std::size_t i = 0; i < searched; ++i) {
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
  const double raw = linear(raw_m, stretch);
  Eigen::VectorXd gradient(2 + model.wiggle.size() + model.nodes.size());
  gradient << 1.0, raw, wiggleShares(model, raw), nodeShares(model, pixel);
  return gradient * (isRange(model) ? 1.0 / stretch : -depth * depth);
}

Eigen::MatrixXd DepthProblem::covarianceAt(const DepthFit& fit, const DepthView& view) const {
  Eigen::MatrixXd gradients(view.raw_m.size(), fit.covariance.rows());
  for (Eigen::Index k = 0; k < view.raw_m.size(); ++k)
    gradients.row(k) = gradient(fit.model, view.pixels[static_cast<std::size_t>(k)], view.raw_m[k]).transpose();
  return gradients * fit.covariance * gradients.transpose();
}

}  // namespace servocal::calib
