// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/plan/detectability.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace servocal::plan {
namespace {

constexpr double kSizePx = 12.0, kObliquityRad = M_PI / 4.0;
// Logit 2.94 at 45 degrees and 0 at 60; half the size costs 2.
const Eigen::Vector3d kSupposed(2.94, 3.0, -2.94 / (M_PI / 12.0));
const Eigen::Vector3d kSupposedSigma(2.0, 1.5, 6.0);
constexpr int kIterations = 25;

double logistic(double logit) { return 1.0 / (1.0 + std::exp(-logit)); }

}  // namespace

Detectability::Detectability(const BoardSpec& board, const CameraModel& camera)
    : camera_(camera), weights_(kSupposed) {
  const std::vector<Eigen::Vector3d> corners = board.corners();
  spacing_m_ = INFINITY;
  for (std::size_t i = 1; i < corners.size(); ++i) {
    spacing_m_ = std::min(spacing_m_, (corners[i] - corners.front()).norm());
  }
}

Eigen::Vector3d Detectability::features(const Pose<Color, Board>& cMo) const {
  const double distance_m = cMo.translation().norm();
  const double cosine = std::clamp(cMo.rotation().col(2).dot(cMo.translation()) / distance_m, 1e-3, 1.0);
  const double size_px = camera_.fx() * spacing_m_ / distance_m * cosine;
  return {1.0, std::log(size_px / kSizePx), std::acos(cosine) - kObliquityRad};
}

double Detectability::probability(const Pose<Color, Board>& cMo) const {
  return logistic(weights_.dot(features(cMo)));
}

void Detectability::learn(const std::vector<Trial>& trials) {
  const Eigen::Vector3d supposed = kSupposedSigma.cwiseAbs2().cwiseInverse();
  const auto minusLogPosterior = [&](const Eigen::Vector3d& weights) {
    double sum = 0.5 * (weights - kSupposed).cwiseAbs2().dot(supposed);
    for (const Trial& trial : trials) {
      const double logit = weights.dot(features(trial.cMo));
      sum += std::log1p(std::exp(trial.detected ? -logit : logit));
    }
    return sum;
  };
  weights_ = kSupposed;
  for (int i = 0; i < kIterations; ++i) {
    Eigen::Vector3d gradient = supposed.cwiseProduct(weights_ - kSupposed);
    Eigen::Matrix3d hessian = supposed.asDiagonal();
    for (const Trial& trial : trials) {
      const Eigen::Vector3d x = features(trial.cMo);
      const double p = logistic(weights_.dot(x));
      gradient += (p - (trial.detected ? 1.0 : 0.0)) * x;
      hessian += p * (1.0 - p) * x * x.transpose();
    }
    Eigen::Vector3d step = hessian.ldlt().solve(gradient);
    const double before = minusLogPosterior(weights_);
    while (step.norm() > 1e-9 && minusLogPosterior(weights_ - step) > before) step *= 0.5;
    weights_ -= step;
    if (step.norm() < 1e-6) break;
  }
}

}  // namespace servocal::plan
