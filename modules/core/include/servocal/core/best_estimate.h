// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "servocal/core/result.h"

namespace servocal {

/// The numbers to work with: where the joint estimate has a stream, its lens and poses (camera, board, color to infrared,
/// one camera beside another) take the place of those found in stages, so that clouds, registered depth and other
/// programs' files all rest on one estimate. What belongs to the stages alone (views, solutions with outliers, residuals
/// of hand-eye) is dropped with them, covariances of intrinsics too. Cameras that the joint estimate does not have, and
/// results without one, stay as they are.
[[nodiscard]] CalibrationResult bestEstimate(const CalibrationResult& result);

}  // namespace servocal
