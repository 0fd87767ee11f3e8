// SPDX-License-Identifier: GPL-3.0-or-later
#include "lens.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace servocal::sim {
namespace {

constexpr double kAspectSpread = 0.001;  // fy over fx.
constexpr double kSmallestDistortion = 0.04;

}  // namespace

Lens Lens::draw(const SimulatedSensorConfig& config, int width_px, int height_px, Random& random) {
  if (config.distortion.size() != 5) {
    throw std::invalid_argument(
        "sim::Cell: a simulated lens needs 5 distortion coefficients (k1 k2 p1 p2 k3)");
  }
  Lens lens;
  lens.width_px = width_px;
  lens.height_px = height_px;
  lens.fx = config.focal_px * (1.0 + random.uniform(-1.0, 1.0) * config.focal_spread);
  lens.fy = lens.fx * (1.0 + random.uniform(-1.0, 1.0) * kAspectSpread);
  lens.cx = 0.5 * (width_px - 1) + random.uniform(-1.0, 1.0) * config.principal_point_spread_px;
  lens.cy = 0.5 * (height_px - 1) + random.uniform(-1.0, 1.0) * config.principal_point_spread_px;
  double* const coefficients[] = {&lens.k1, &lens.k2, &lens.p1, &lens.p2, &lens.k3};
  for (int i = 0; i < 5; ++i) {
    *coefficients[i] = config.distortion[i] * (1.0 + random.uniform(-1.0, 1.0) * config.distortion_spread);
  }
  // A lens without distortion would let a mistake in it pass.
  lens.k1 = std::copysign(std::max(std::abs(lens.k1), kSmallestDistortion), lens.k1);
  return lens;
}

Eigen::Vector2d Lens::distort(const Eigen::Vector2d& ideal) const {
  const double x = ideal.x(), y = ideal.y();
  const double r2 = x * x + y * y;
  const double radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
  return {x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
          y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y};
}

Eigen::Vector2d Lens::project(const Eigen::Vector3d& point_c) const {
  const Eigen::Vector2d distorted = distort(point_c.head<2>() / point_c.z());
  return {fx * distorted.x() + cx, fy * distorted.y() + cy};
}

Eigen::Vector2d Lens::unproject(const Eigen::Vector2d& pixel, const Eigen::Vector2d& guess) const {
  const Eigen::Vector2d wanted((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  Eigen::Vector2d ideal = guess;
  for (int iteration = 0; iteration < 20; ++iteration) {
    const Eigen::Vector2d error = distort(ideal) - wanted;
    if (error.cwiseAbs().maxCoeff() < 1e-13) break;
    const double x = ideal.x(), y = ideal.y();
    const double r2 = x * x + y * y;
    const double radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    const double slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2));  // d radial / dx = x slope
    const double xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x;
    const double yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x;
    const double xy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
    const double determinant = xx * yy - xy * xy;
    ideal.x() -= (yy * error.x() - xy * error.y()) / determinant;
    ideal.y() -= (xx * error.y() - xy * error.x()) / determinant;
  }
  return ideal;
}

Eigen::Vector2d Lens::unproject(const Eigen::Vector2d& pixel) const {
  return unproject(pixel, Eigen::Vector2d((pixel.x() - cx) / fx, (pixel.y() - cy) / fy));
}

RayTable::RayTable(const Lens& lens)
    : width_px(lens.width_px), height_px(lens.height_px), max_radius(0.0),
      x(static_cast<std::size_t>(width_px) * height_px), y(x.size()) {
  Eigen::Vector2d row_guess = lens.unproject({0.0, 0.0});
  std::size_t index = 0;
  for (int v = 0; v < height_px; ++v) {
    // The neighbours' rays, extrapolated, leave one or two Newton steps.
    Eigen::Vector2d ray = row_guess, previous = row_guess, guess = row_guess;
    for (int u = 0; u < width_px; ++u, ++index) {
      ray = lens.unproject({static_cast<double>(u), static_cast<double>(v)}, guess);
      if (u == 0) {
        row_guess = ray;
        previous = ray;
      }
      guess = 2.0 * ray - previous;
      previous = ray;
      x[index] = static_cast<float>(ray.x());
      y[index] = static_cast<float>(ray.y());
      max_radius = std::max(max_radius, ray.squaredNorm());
    }
  }
  max_radius = std::sqrt(max_radius);
}

}  // namespace servocal::sim
