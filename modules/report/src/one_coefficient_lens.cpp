// SPDX-License-Identifier: GPL-3.0-or-later
#include "one_coefficient_lens.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace servocal::report {
namespace {

struct Sample {
  Eigen::Vector2d pixel;
  Eigen::Vector2d ray;  ///< Normalized coordinates seen there by the lens.
};

std::vector<Sample> samplesOf(const CameraModel& lens) {
  constexpr int kAcross = 48, kDown = 36;
  std::vector<Sample> samples;
  for (int row = 0; row < kDown; ++row) {
    for (int column = 0; column < kAcross; ++column) {
      const Eigen::Vector2d pixel((lens.width_px - 1) * static_cast<double>(column) / (kAcross - 1),
                                  (lens.height_px - 1) * static_cast<double>(row) / (kDown - 1));
      if (const auto ray = lens.unproject(pixel)) samples.push_back({pixel, *ray});
    }
  }
  if (samples.empty()) throw std::invalid_argument("the lens sees no pixel of its image");
  return samples;
}

/// Gauss-Newton over px, py, u0, v0, kud (ViSP's forward model is plumb_bob with k1 alone).
CameraModel fitForward(const CameraModel& lens, const std::vector<Sample>& samples) {
  CameraModel fit = lens;
  fit.lens = LensModel::kPlumbBob;
  fit.parameters = Eigen::VectorXd::Zero(parameterCount(fit.lens));
  fit.parameters.head<5>() = lens.parameters.head<5>();
  for (int iteration = 0; iteration < 50; ++iteration) {
    Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
    Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
    for (const Sample& sample : samples) {
      ProjectionJacobian jacobian;
      const auto pixel = fit.project(sample.ray.homogeneous(), jacobian);
      if (!pixel) continue;  // beyond the fold of this step's lens
      const Eigen::Matrix<double, 2, 5> by = jacobian.parameters.leftCols<5>();
      normal += by.transpose() * by;
      right += by.transpose() * (sample.pixel - *pixel);
    }
    const Eigen::Matrix<double, 5, 1> step = normal.ldlt().solve(right);
    fit.parameters.head<5>() += step;
    if (step.norm() < 1e-12 * fit.parameters.head<5>().norm()) break;
  }
  return fit;
}

}  // namespace

OneCoefficientLens fitOneCoefficientLens(const CameraModel& lens) {
  const std::vector<Sample> samples = samplesOf(lens);
  const CameraModel forward = fitForward(lens, samples);
  OneCoefficientLens fit;
  fit.px = forward.fx();
  fit.py = forward.fy();
  fit.u0 = forward.cx();
  fit.v0 = forward.cy();
  fit.kud = forward.parameters[4];

  const Eigen::Vector2d focal(fit.px, fit.py), centre(fit.u0, fit.v0);
  const auto inverse = [&](const Sample& sample, double kdu) {
    const Eigen::Vector2d plain = (sample.pixel - centre).cwiseQuotient(focal);
    return Eigen::Vector2d(plain * (1.0 + kdu * plain.squaredNorm()));
  };
  double numerator = 0.0, denominator = 0.0;  // linear in kdu
  for (const Sample& sample : samples) {
    const Eigen::Vector2d plain = (sample.pixel - centre).cwiseQuotient(focal);
    const Eigen::Vector2d by_kdu = focal.cwiseProduct(plain * plain.squaredNorm());
    numerator += by_kdu.dot(focal.cwiseProduct(sample.ray - plain));
    denominator += by_kdu.squaredNorm();
  }
  fit.kdu = denominator > 0.0 ? numerator / denominator : 0.0;

  for (const Sample& sample : samples) {
    const double r2 = sample.ray.squaredNorm();
    const Eigen::Vector2d seen = centre + focal.cwiseProduct(sample.ray) * (1.0 + fit.kud * r2);
    const double forward_px = (seen - sample.pixel).norm();
    const double inverse_px = focal.cwiseProduct(inverse(sample, fit.kdu) - sample.ray).norm();
    fit.forward_rms_px += forward_px * forward_px;
    fit.inverse_rms_px += inverse_px * inverse_px;
    fit.forward_max_px = std::max(fit.forward_max_px, forward_px);
    fit.inverse_max_px = std::max(fit.inverse_max_px, inverse_px);
  }
  fit.forward_rms_px = std::sqrt(fit.forward_rms_px / static_cast<double>(samples.size()));
  fit.inverse_rms_px = std::sqrt(fit.inverse_rms_px / static_cast<double>(samples.size()));
  return fit;
}

}  // namespace servocal::report
