// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/camera_model.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace servocal {
namespace {

constexpr double kMinDepthM = 1e-6;

/// The distortion and its derivatives at one normalized point.
struct Distorted {
  Eigen::Vector2d point;
  Eigen::Matrix2d by_point;
  Eigen::Matrix<double, 2, 8> by_coefficient;  // k1 k2 p1 p2 k3 k4 k5 k6
};

Distorted distort(const Eigen::VectorXd& parameters, const Eigen::Vector2d& normalized) {
  const double k1 = parameters[4], k2 = parameters[5], p1 = parameters[6], p2 = parameters[7],
               k3 = parameters[8];
  const bool rational = parameters.size() > 9;
  const double k4 = rational ? parameters[9] : 0, k5 = rational ? parameters[10] : 0,
               k6 = rational ? parameters[11] : 0;
  const double x = normalized.x(), y = normalized.y();
  const double r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
  const double numerator = 1 + k1 * r2 + k2 * r4 + k3 * r6;
  const double denominator = 1 + k4 * r2 + k5 * r4 + k6 * r6;
  const double radial = numerator / denominator;
  const double radial_by_r2 =
      ((k1 + 2 * k2 * r2 + 3 * k3 * r4) - radial * (k4 + 2 * k5 * r2 + 3 * k6 * r4)) / denominator;

  Distorted out;
  out.point = {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
               y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
  const double cross = 2 * x * y * radial_by_r2 + 2 * p1 * x + 2 * p2 * y;
  out.by_point << radial + 2 * x * x * radial_by_r2 + 2 * p1 * y + 6 * p2 * x, cross,  //
      cross, radial + 2 * y * y * radial_by_r2 + 6 * p1 * y + 2 * p2 * x;
  const Eigen::Vector2d by_numerator = normalized / denominator;
  const Eigen::Vector2d by_denominator = -normalized * radial / denominator;
  out.by_coefficient.col(0) = by_numerator * r2;
  out.by_coefficient.col(1) = by_numerator * r4;
  out.by_coefficient.col(2) = Eigen::Vector2d(2 * x * y, r2 + 2 * y * y);
  out.by_coefficient.col(3) = Eigen::Vector2d(r2 + 2 * x * x, 2 * x * y);
  out.by_coefficient.col(4) = by_numerator * r6;
  out.by_coefficient.col(5) = by_denominator * r2;
  out.by_coefficient.col(6) = by_denominator * r4;
  out.by_coefficient.col(7) = by_denominator * r6;
  return out;
}

/// True while the distorted radius still grows with the radius all the way out to `normalized`: beyond
/// the fold two rays share a pixel and the model means nothing. Tangential terms do not fold.
bool insideFold(const Eigen::VectorXd& parameters, const Eigen::Vector2d& normalized) {
  const double k1 = parameters[4], k2 = parameters[5], k3 = parameters[8];
  const bool rational = parameters.size() > 9;
  const double k4 = rational ? parameters[9] : 0, k5 = rational ? parameters[10] : 0,
               k6 = rational ? parameters[11] : 0;
  const auto grows = [&](double r2) {
    const double numerator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
    const double denominator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6));
    const double d_numerator = k1 + r2 * (2 * k2 + r2 * 3 * k3);
    const double d_denominator = k4 + r2 * (2 * k5 + r2 * 3 * k6);
    // d(r radial)/dr = radial + 2 r2 d(radial)/d(r2), times denominator^2.
    return denominator > 0 &&
           numerator * denominator + 2 * r2 * (d_numerator * denominator - numerator * d_denominator) > 0;
  };
  const double r2 = normalized.squaredNorm();
  // Without the denominator the derivative is 1 + 3 k1 r2 + 5 k2 r2^2 + 7 k3 r2^3; if its negative terms
  // alone cannot undo the one, there is nothing to look for (nearly every point of nearly every lens).
  if (!rational && 1 + r2 * (std::min(0.0, 3 * k1) + r2 * (std::min(0.0, 5 * k2) + r2 * std::min(0.0, 7 * k3))) > 0) {
    return true;
  }
  constexpr int kSteps = 8;  // lens polynomials have at most three turning points in the image
  for (int i = 1; i <= kSteps; ++i) {
    if (!grows(r2 * i / kSteps)) return false;
  }
  return true;
}

}  // namespace

const char* toString(LensModel lens) {
  return lens == LensModel::kPlumbBob ? "plumb_bob" : "rational_polynomial";
}

int parameterCount(LensModel lens) { return lens == LensModel::kPlumbBob ? 9 : 12; }

const std::vector<std::string>& parameterNames(LensModel lens) {
  static const std::vector<std::string> plumb_bob = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"};
  static const std::vector<std::string> rational = {"fx", "fy", "cx", "cy", "k1", "k2",
                                                    "p1", "p2", "k3", "k4", "k5", "k6"};
  return lens == LensModel::kPlumbBob ? plumb_bob : rational;
}

CameraModel CameraModel::fromFieldOfView(int width_px, int height_px, double horizontal_fov_rad,
                                         LensModel lens) {
  if (width_px <= 0 || height_px <= 0) throw std::invalid_argument("image size must be positive");
  if (!(horizontal_fov_rad > 0 && horizontal_fov_rad < M_PI)) {
    throw std::invalid_argument("horizontal_fov_rad must lie between 0 and pi");
  }
  CameraModel camera;
  camera.lens = lens;
  camera.width_px = width_px;
  camera.height_px = height_px;
  camera.parameters = Eigen::VectorXd::Zero(parameterCount(lens));
  camera.parameters[0] = camera.parameters[1] = 0.5 * width_px / std::tan(0.5 * horizontal_fov_rad);
  camera.parameters[2] = 0.5 * (width_px - 1);
  camera.parameters[3] = 0.5 * (height_px - 1);
  return camera;
}

std::optional<Eigen::Vector2d> CameraModel::project(const Eigen::Vector3d& point_c) const {
  if (!(point_c.z() > kMinDepthM)) return std::nullopt;
  const Eigen::Vector2d normalized = point_c.head<2>() * (1.0 / point_c.z());
  if (!insideFold(parameters, normalized)) return std::nullopt;
  const Eigen::Vector2d distorted = distort(parameters, normalized).point;
  return Eigen::Vector2d(parameters.head<2>().cwiseProduct(distorted) + parameters.segment<2>(2));
}

std::optional<Eigen::Vector2d> CameraModel::project(const Eigen::Vector3d& point_c,
                                                    ProjectionJacobian& jacobian) const {
  if (!(point_c.z() > kMinDepthM)) return std::nullopt;
  const double inverse_z = 1.0 / point_c.z();
  const Eigen::Vector2d normalized = point_c.head<2>() * inverse_z;
  if (!insideFold(parameters, normalized)) return std::nullopt;
  const Distorted distorted = distort(parameters, normalized);
  const Eigen::Vector2d focal(fx(), fy());

  Eigen::Matrix<double, 2, 3> normalized_by_point;
  normalized_by_point << inverse_z, 0, -normalized.x() * inverse_z,  //
      0, inverse_z, -normalized.y() * inverse_z;
  jacobian.point = focal.asDiagonal() * distorted.by_point * normalized_by_point;
  jacobian.parameters.setZero(2, parameters.size());
  jacobian.parameters(0, 0) = distorted.point.x();
  jacobian.parameters(1, 1) = distorted.point.y();
  jacobian.parameters(0, 2) = 1;
  jacobian.parameters(1, 3) = 1;
  const Eigen::Index coefficients = parameters.size() - 4;
  jacobian.parameters.rightCols(coefficients) =
      focal.asDiagonal() * distorted.by_coefficient.leftCols(coefficients);
  return Eigen::Vector2d(focal.cwiseProduct(distorted.point) + parameters.segment<2>(2));
}

std::optional<Eigen::Vector2d> CameraModel::unproject(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d target = (pixel - parameters.segment<2>(2)).cwiseQuotient(parameters.head<2>());
  Eigen::Vector2d normalized = target;
  for (int iteration = 0; iteration < 30; ++iteration) {
    const Distorted distorted = distort(parameters, normalized);
    const Eigen::Vector2d error = distorted.point - target;
    const double determinant = distorted.by_point.determinant();
    if (!(std::abs(determinant) > 1e-12)) return std::nullopt;
    Eigen::Vector2d step = distorted.by_point.inverse() * error;
    const double reach = 0.3 + 0.3 * normalized.norm();
    if (step.norm() > reach) step *= reach / step.norm();
    normalized -= step;
    if (step.norm() < 1e-14) break;
  }
  if (!normalized.allFinite() || !insideFold(parameters, normalized)) return std::nullopt;
  if ((distort(parameters, normalized).point - target).norm() > 1e-10) return std::nullopt;
  return normalized;
}

bool CameraModel::contains(const Eigen::Vector2d& pixel, double margin_px) const {
  return pixel.x() >= margin_px && pixel.y() >= margin_px && pixel.x() <= width_px - 1 - margin_px &&
         pixel.y() <= height_px - 1 - margin_px;
}

}  // namespace servocal
