// SPDX-License-Identifier: GPL-3.0-or-later
// The simulator's own camera model. It shares no code with CameraModel on purpose: a mistake there must
// show as a calibration error, not cancel out.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "random.h"
#include "servocal/core/simulation.h"

namespace servocal::sim {

/// Pinhole with radial (k1 k2 k3) and tangential (p1 p2) distortion; pixel (0,0) is the centre of the
/// top-left pixel. Source: Brown, "Close-Range Camera Calibration", 1971, in OpenCV's notation.
struct Lens {
  int width_px = 0;
  int height_px = 0;
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;
  double k1 = 0.0, k2 = 0.0, p1 = 0.0, p2 = 0.0, k3 = 0.0;

  /// The lens of one seed.
  static Lens draw(const SimulatedSensorConfig& config, int width_px, int height_px, Random& random);

  /// Distorted normalized coordinates of undistorted ones.
  Eigen::Vector2d distort(const Eigen::Vector2d& ideal) const;
  Eigen::Vector2d project(const Eigen::Vector3d& point_c) const;
  /// Undistorted normalized coordinates seen at a pixel, by Newton's method from `guess`.
  Eigen::Vector2d unproject(const Eigen::Vector2d& pixel, const Eigen::Vector2d& guess) const;
  Eigen::Vector2d unproject(const Eigen::Vector2d& pixel) const;
};

/// The undistorted ray of every pixel, row by row.
struct RayTable {
  explicit RayTable(const Lens& lens);
  const float* xRow(int row) const { return x.data() + static_cast<std::size_t>(row) * width_px; }
  const float* yRow(int row) const { return y.data() + static_cast<std::size_t>(row) * width_px; }

  int width_px;
  int height_px;
  double max_radius;  ///< Largest distance of a ray from the axis, normalized.
  std::vector<float> x;
  std::vector<float> y;
};

}  // namespace servocal::sim
