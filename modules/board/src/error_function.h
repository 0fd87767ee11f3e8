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
      rows_[k] = {std::erf(t / std::sqrt(2.0)), std::sqrt(2.0 / M_PI) * std::exp(-0.5 * t * t)};
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
    value = rows_[k].value + f * (rows_[k + 1].value - rows_[k].value);
    slope = rows_[k].slope + f * (rows_[k + 1].slope - rows_[k].slope);
  }

 private:
  static constexpr int kSize = 1024;
  static constexpr double kRange = 4.5;
  struct Row {
    double value, slope;  // Side by side in memory: they are read together.
  };
  std::array<Row, kSize + 1> rows_;
};

}  // namespace servocal::board
