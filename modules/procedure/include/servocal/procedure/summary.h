// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "servocal/core/result.h"
#include "servocal/procedure/calibrate.h"

namespace servocal::procedure {

/// One line for a terminal: stage, views done of planned, ETA, reprojection error, hand-eye scatter.
std::string line(const Event& event);

/// Whether the goal is met, and what it lacks; one line.
std::string verdict(const CalibrationResult& result);

/// The result for a person, ending with a newline.
std::string summary(const CalibrationResult& result);

}  // namespace servocal::procedure
