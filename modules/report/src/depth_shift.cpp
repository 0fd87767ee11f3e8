// SPDX-License-Identifier: GPL-3.0-or-later
#include "depth_shift.h"

#include <cmath>
#include <stdexcept>
#include <vector>

namespace servocal::report {

DepthShift fitDepthShift(const DepthModel& model) {
  if (!(model.near_m > 0.0 && model.far_m >= model.near_m)) {
    throw std::invalid_argument("the depth model has no range");
  }
  constexpr int kPixels = 24, kRanges = 16;
  std::vector<double> corrections_m;
  for (int range = 0; range < kRanges; ++range) {
    const double raw_m = model.near_m + (model.far_m - model.near_m) * range / (kRanges - 1);
    for (int i = 0; i < kPixels * kPixels; ++i) {
      const Eigen::Vector2d pixel((i % kPixels + 0.5) / kPixels * (model.camera.width_px - 1),
                                  (i / kPixels + 0.5) / kPixels * (model.camera.height_px - 1));
      if (const auto corrected_m = model.correct(pixel, raw_m)) corrections_m.push_back(*corrected_m - raw_m);
    }
  }
  if (corrections_m.empty()) throw std::invalid_argument("the depth model corrects nothing in its range");
  DepthShift shift;
  const auto count = static_cast<double>(corrections_m.size());
  for (const double correction_m : corrections_m) shift.shift_m += correction_m / count;
  for (const double correction_m : corrections_m) {
    const double left_m = correction_m - shift.shift_m;
    shift.rms_m += left_m * left_m / count;
    shift.max_m = std::max(shift.max_m, std::abs(left_m));
  }
  shift.rms_m = std::sqrt(shift.rms_m);
  return shift;
}

}  // namespace servocal::report
