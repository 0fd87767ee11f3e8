// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <vector>

#include "servocal/core/result.h"

namespace servocal::report {

/// What to do next, most urgent first, a sentence each, with the evidence. Never empty.
std::vector<std::string> nextSteps(const CalibrationResult& result);

}  // namespace servocal::report
