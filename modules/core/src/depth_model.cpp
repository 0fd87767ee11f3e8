// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/depth_model.h"

#include <algorithm>
#include <cmath>

namespace servocal {

double DepthModel::lattice(const Eigen::Vector2d& pixel) const {
  const auto place = [](double at, int size_px, int count) {
    return std::clamp(at / (size_px - 1), 0.0, 1.0) * (count - 1);
  };
  const double x = place(pixel.x(), camera.width_px, nodes_x), y = place(pixel.y(), camera.height_px, nodes_y);
  const int column = std::min(static_cast<int>(x), nodes_x - 2), row = std::min(static_cast<int>(y), nodes_y - 2);
  const double fx = x - column, fy = y - row;
  const auto node = [&](int dx, int dy) { return nodes[(row + dy) * nodes_x + column + dx]; };
  return (1 - fy) * ((1 - fx) * node(0, 0) + fx * node(1, 0)) + fy * ((1 - fx) * node(0, 1) + fx * node(1, 1));
}

double DepthModel::wiggling(double range_m) const {
  if (wiggle.size() == 0) return 0.0;
  const Eigen::Index last = wiggle.size() - 1;
  const double at = std::clamp((range_m - wiggle_from_m) / (wiggle_to_m - wiggle_from_m), 0.0, 1.0) *
                    static_cast<double>(last);
  const Eigen::Index node = std::min(static_cast<Eigen::Index>(at), last - 1);
  const double beyond = at - static_cast<double>(node);
  return (1 - beyond) * wiggle[node] + beyond * wiggle[node + 1];
}

std::optional<double> DepthModel::correct(const Eigen::Vector2d& pixel, double raw_m) const {
  if (!(raw_m > 0.0) || !std::isfinite(raw_m)) return std::nullopt;
  double corrected_m = 0.0;
  if (sensor == DepthSensor::kStructuredLight) {
    corrected_m = 1.0 / (offset + slope / raw_m + lattice(pixel));
  } else {
    const auto ray = camera.unproject(pixel);
    if (!ray) return std::nullopt;
    const double stretch = std::sqrt(1.0 + ray->squaredNorm());
    const double range_m = raw_m * stretch;
    corrected_m = (offset + slope * range_m + wiggling(range_m) + lattice(pixel)) / stretch;
  }
  if (!(corrected_m > 0.0) || !std::isfinite(corrected_m)) return std::nullopt;
  return corrected_m;
}

}  // namespace servocal
