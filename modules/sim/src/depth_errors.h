// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>

#include "lens.h"
#include "random.h"
#include "servocal/core/cell_config.h"

namespace servocal::sim {

/// What one depth camera measures on average, on white, where the true depth is z: its systematic errors of
/// one seed. Shares no code and no shape with DepthModel on purpose: the corrections that a calibration can
/// express are not the errors that a camera has.
///
/// - Time of flight errs along the ray, r = z |(x, y, 1)|: an offset, a slope, two harmonics of a wiggle, and
///   a field over the image that grows slowly with r.
/// - Structured light errs in its disparity, baseline x focal length / z: an offset, a scale, and such a
/// field.
///
/// The field is a sum of plane waves longer than half the image and one bump a fifth of it wide.
class DepthErrors {
 public:
  DepthErrors(DepthSensor sensor, const SimulatedDepthConfig& config, const Lens& lens, Random& random);

  /// Depth along the axis, m, before noise and quantisation.
  double measured(const Eigen::Vector2d& pixel, double true_m) const;
  /// Its inverse.
  double trueDepth(const Eigen::Vector2d& pixel, double measured_m) const;

  /// The parts, for the renderer's tables. The error along the ray (m), or in the disparity (px), is
  /// axial + field * fieldGain.
  double axial(double range_m) const;  ///< Time of flight: of the range.
  double field(const Eigen::Vector2d& pixel) const;
  static double fieldGain(double range_m) { return 1.0 + 0.2 * (range_m - 1.0); }
  double disparityOffsetPx() const { return offset_; }
  double disparityScale() const { return 1.0 + slope_; }
  double focalBaseline() const { return focal_baseline_; }  ///< Disparity times depth, px m.
  DepthSensor sensor() const { return sensor_; }

 private:
  struct Wave {
    Eigen::Vector2d per_px;  ///< Phase per pixel, rad.
    double phase;
    double weight;
  };
  double rawField(const Eigen::Vector2d& pixel) const;

  DepthSensor sensor_;
  Lens lens_;
  double focal_baseline_;
  double offset_ = 0.0;  ///< m at 1 m, or px.
  double slope_ = 0.0;
  double wiggle_m_ = 0.0;
  std::array<double, 2> wiggle_phase_{};
  std::array<Wave, 6> waves_{};
  Eigen::Vector2d bump_px_;
  double bump_width_px_ = 1.0;
  double bump_ = 0.0;
  double field_mean_ = 0.0;
  double field_scale_ = 1.0;
};

}  // namespace servocal::sim
