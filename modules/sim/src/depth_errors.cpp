// SPDX-License-Identifier: GPL-3.0-or-later
#include "depth_errors.h"

#include <cmath>

namespace servocal::sim {
namespace {

// Half wavelengths of modulation frequencies near a Kinect v2's 80 and 120 MHz beating with 16 MHz.
constexpr double kWigglePeriodM[] = {1.25, 0.47};
constexpr double kWiggleWeight[] = {0.8, 0.4};

}  // namespace

DepthErrors::DepthErrors(DepthSensor sensor, const SimulatedDepthConfig& config, const Lens& lens,
                         Random& random)
    : sensor_(sensor), lens_(lens), focal_baseline_(lens.fx * config.baseline_m) {
  const bool disparity = sensor == DepthSensor::kStructuredLight;
  // At 1 m, one pixel more of disparity is 1 / focal_baseline metres less of depth.
  const double per_m = disparity ? -focal_baseline_ : 1.0;
  offset_ = per_m * (config.offset_m + random.uniform(-1.0, 1.0) * config.offset_spread_m);
  slope_ = (disparity ? -1.0 : 1.0) * random.uniform(-1.0, 1.0) * config.slope_spread;
  if (disparity) offset_ -= slope_ * focal_baseline_;  // The slope alone changes nothing at 1 m.
  wiggle_m_ = config.wiggle_m;
  for (double& phase : wiggle_phase_) phase = random.uniform(0.0, 2.0 * M_PI);

  for (Wave& wave : waves_) {
    const double direction = random.uniform(0.0, 2.0 * M_PI);
    const double length_px = lens.width_px * random.uniform(0.6, 2.0);
    wave.per_px = Eigen::Vector2d(std::cos(direction), std::sin(direction)) * (2.0 * M_PI / length_px);
    wave.phase = random.uniform(0.0, 2.0 * M_PI);
    wave.weight = random.normal();
  }
  bump_px_ = {random.uniform(0.2, 0.8) * lens.width_px, random.uniform(0.2, 0.8) * lens.height_px};
  bump_width_px_ = 0.2 * lens.width_px;
  bump_ = 2.0 * random.normal();

  double sum = 0.0, squares = 0.0;
  int count = 0;
  for (int v = 4; v < lens.height_px; v += 8) {
    for (int u = 4; u < lens.width_px; u += 8, ++count) {
      const double value = rawField(Eigen::Vector2d(u, v));
      sum += value;
      squares += value * value;
    }
  }
  field_mean_ = sum / count;
  field_scale_ = per_m * config.lateral_m / std::sqrt(squares / count - field_mean_ * field_mean_);
}

double DepthErrors::rawField(const Eigen::Vector2d& pixel) const {
  double value =
      bump_ * std::exp(-0.5 * (pixel - bump_px_).squaredNorm() / (bump_width_px_ * bump_width_px_));
  for (const Wave& wave : waves_) value += wave.weight * std::cos(wave.per_px.dot(pixel) + wave.phase);
  return value;
}

double DepthErrors::field(const Eigen::Vector2d& pixel) const {
  return field_scale_ * (rawField(pixel) - field_mean_);
}

double DepthErrors::axial(double range_m) const {
  double wiggle = 0.0;
  for (int i = 0; i < 2; ++i) {
    wiggle += kWiggleWeight[i] * std::sin(2.0 * M_PI * range_m / kWigglePeriodM[i] + wiggle_phase_[i]);
  }
  return offset_ + slope_ * (range_m - 1.0) + wiggle_m_ * wiggle;
}

double DepthErrors::measured(const Eigen::Vector2d& pixel, double true_m) const {
  if (sensor_ == DepthSensor::kStructuredLight) {
    const double disparity = focal_baseline_ / true_m;
    return focal_baseline_ /
           (disparity * disparityScale() + disparityOffsetPx() + field(pixel) * fieldGain(true_m));
  }
  const Eigen::Vector2d ray = lens_.unproject(pixel);
  const double stretch = std::sqrt(1.0 + ray.squaredNorm());
  const double range = true_m * stretch;
  return (range + axial(range) + field(pixel) * fieldGain(range)) / stretch;
}

double DepthErrors::trueDepth(const Eigen::Vector2d& pixel, double measured_m) const {
  double depth = measured_m;  // The errors change slowly with depth: a fixed point, reached fast.
  for (int iteration = 0; iteration < 60; ++iteration) {
    const double miss = measured(pixel, depth) - measured_m;
    depth -= miss;
    if (std::abs(miss) < 1e-12) break;
  }
  return depth;
}

}  // namespace servocal::sim
