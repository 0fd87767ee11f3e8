// SPDX-License-Identifier: GPL-3.0-or-later
// Did anything move that should not have?
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/core/result.h"

namespace servocal::procedure {

/// A sentence if the board slipped on its mount or a camera was moved while the observations were taken; by the
/// result's own intrinsics and poses. For cameras that stand in the cell.
std::optional<std::string> slipDuring(const std::vector<Observation>& observations, const CalibrationResult& result);

}  // namespace servocal::procedure
