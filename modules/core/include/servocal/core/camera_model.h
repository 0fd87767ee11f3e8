// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

namespace servocal {

/// Lens model, OpenCV's parameters and order.
enum class LensModel {
  kPlumbBob,  ///< fx fy cx cy k1 k2 p1 p2 k3: 9 parameters.
  kRational,  ///< ... k4 k5 k6: 12 parameters.
};

/// "plumb_bob" or "rational_polynomial", as in ROS' camera_info.
const char* toString(LensModel lens);
/// Number of entries of CameraModel::parameters.
int parameterCount(LensModel lens);
/// "fx", "fy", "cx", "cy", "k1", ... in the order of CameraModel::parameters.
const std::vector<std::string>& parameterNames(LensModel lens);

/// Derivatives of a projection, pixels per unit.
struct ProjectionJacobian {
  Eigen::Matrix<double, 2, 3> point;              ///< By the point in the camera frame, px/m.
  Eigen::Matrix<double, 2, Eigen::Dynamic> parameters;  ///< By CameraModel::parameters.
};

/// Pinhole camera with lens distortion. Pixel (0,0) is the centre of the top-left pixel.
///
/// u = fx x'' + cx, v = fy y'' + cy with, for x = X/Z, y = Y/Z, r2 = x^2 + y^2,
///   radial = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
///   x'' = x radial + 2 p1 x y + p2 (r2 + 2 x^2),  y'' = y radial + p1 (r2 + 2 y^2) + 2 p2 x y.
///
/// Source: OpenCV 4 calib3d reference ("Camera Calibration and 3D Reconstruction"); Brown 1971.
struct CameraModel {
  LensModel lens = LensModel::kPlumbBob;
  int width_px = 0;
  int height_px = 0;
  Eigen::VectorXd parameters;  ///< parameterCount(lens) entries, order as parameterNames(lens).

  double fx() const { return parameters[0]; }
  double fy() const { return parameters[1]; }
  double cx() const { return parameters[2]; }
  double cy() const { return parameters[3]; }

  /// A distortion-free camera from what a data sheet says; principal point at the image centre.
  /// @throws std::invalid_argument unless sizes are positive and 0 < horizontal_fov_rad < pi.
  static CameraModel fromFieldOfView(int width_px, int height_px, double horizontal_fov_rad,
                                     LensModel lens = LensModel::kPlumbBob);

  /// Pixel of a point in the camera frame (m). Nothing if the point is not in front of the camera
  /// (Z <= 1e-6 m), or so far off axis that the distortion polynomial folds back.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_c) const;
  /// The same with derivatives, checked against differences in the tests.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_c,
                                         ProjectionJacobian& jacobian) const;
  /// Normalized coordinates (X/Z, Y/Z) seen at a pixel; inverse of project to 1e-10.
  /// Nothing if no point projects there (beyond the fold of the distortion polynomial).
  std::optional<Eigen::Vector2d> unproject(const Eigen::Vector2d& pixel) const;
  /// True if the pixel lies inside the image by at least `margin_px`.
  bool contains(const Eigen::Vector2d& pixel, double margin_px = 0.0) const;
};

}  // namespace servocal
