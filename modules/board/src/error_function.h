// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cmath>

namespace servocal::board {

/// erf(t / sqrt 2), the brightness across an edge blurred by one unit, and its derivative; from a table.
class ErrorFunction {
 public:
  ErrorFunction() {
    for (int k = 0; k <= kSize; ++k) {
      const double t = kRange * (2.0 * k / kSize - 1.0);
      value_[k] = std::erf(t / std::sqrt(2.0));
      slope_[k] = std::sqrt(2.0 / M_PI) * std::exp(-0.5 * t * t);
    }
  }
  void at(double t, double& value, double& slope) const {
    const double place = (t + kRange) * (kSize / (2.0 * kRange));
    if (place <= 0.0 || place >= kSize - 1) {
      value = t < 0 ? -1.0 : 1.0;
      slope = 0.0;
      return;
    }
    const int k = static_cast<int>(place);
    const double f = place - k;
    value = value_[k] + f * (value_[k + 1] - value_[k]);
    slope = slope_[k] + f * (slope_[k + 1] - slope_[k]);
  }

 private:
  static constexpr int kSize = 1024;
  static constexpr double kRange = 4.5;
  std::array<double, kSize + 1> value_;
  std::array<double, kSize + 1> slope_;
};

}  // namespace servocal::board
