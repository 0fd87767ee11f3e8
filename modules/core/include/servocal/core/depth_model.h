// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <optional>

#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"

namespace servocal {

/// Corrects the raw depth of one camera. Depth is along the optical axis, m.
///
/// B is a smooth lattice over the image: bilinear between nodes_x x nodes_y nodes that span it from the middle
/// of the first pixel to that of the last.
///
/// - Structured light errs in disparity: 1/z = offset + slope / z_raw + B(u, v), in 1/m.
/// - Time of flight errs in range r, along the ray: r = offset + slope r_raw + W(r_raw) + B(u, v), in m, with
///   r = z sqrt(1 + x^2 + y^2) and (x, y) the ray of the pixel in `camera`. W, the wiggling error, is linear between nodes.
///
/// Sources: Herrera, Kannala, Heikkila, "Joint Depth and Color Camera Calibration with Distortion Correction",
/// PAMI 34(10), 2012 (disparity); Lindner, Schiller, Kolb, Koch, "Time-of-Flight sensor calibration for
/// accurate range sensing", CVIU 114(12), 2010 (range).
struct DepthModel {
  DepthSensor sensor = DepthSensor::kTimeOfFlight;
  CameraModel camera;          ///< Infrared intrinsics, for the rays; those of the estimate in stages.
  double offset = 0.0;
  double slope = 1.0;
  int nodes_x = 2;             ///< At least 2 each way.
  int nodes_y = 2;
  Eigen::VectorXd nodes = Eigen::VectorXd::Zero(4);  ///< Row by row from the upper left.
  Eigen::VectorXd wiggle;      ///< W at equally spaced raw ranges from wiggle_from_m to wiggle_to_m, at least 2, m; empty:
                               ///< none. Always so for structured light.
  double wiggle_from_m = 0.0;
  double wiggle_to_m = 0.0;
  double near_m = 0.0;         ///< Ranges it was solved from; beyond, it extrapolates.
  double far_m = 0.0;

  /// B at a pixel; pixels outside the image take the value at its border.
  double lattice(const Eigen::Vector2d& pixel) const;
  /// W at a raw range; beyond its nodes the value at the end.
  double wiggling(double range_m) const;
  /// Corrected depth; nothing unless the raw one is finite and positive and so is the result.
  std::optional<double> correct(const Eigen::Vector2d& pixel, double raw_m) const;
};

}  // namespace servocal
