// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "servocal/core/depth_model.h"

namespace servocal::report {

/// A depth correction as one number.
struct DepthShift {
  double shift_m = 0.0;  ///< Added to the raw depth.
  double rms_m = 0.0;    ///< What that leaves of the correction, over the image and the model's ranges,
  double max_m = 0.0;    ///< and at worst.
};

/// The least-squares shift over a grid of pixels and ranges.
/// @throws std::invalid_argument if the model has no range, or corrects nothing in it.
DepthShift fitDepthShift(const DepthModel& model);

}  // namespace servocal::report
