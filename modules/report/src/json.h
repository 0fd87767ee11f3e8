// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

namespace servocal::report {

using Json = nlohmann::ordered_json;

/// To what an eye can see, for smaller files; exact numbers stand in the result. Not finite: null.
inline Json rounded(double value, int digits) {
  if (!std::isfinite(value)) return nullptr;
  const double scale = std::pow(10.0, digits);
  return std::round(value * scale) / scale;
}

inline Json rounded(const Eigen::VectorXd& values, int digits) {
  Json list = Json::array();
  for (const double value : values) list.push_back(rounded(value, digits));
  return list;
}

}  // namespace servocal::report
