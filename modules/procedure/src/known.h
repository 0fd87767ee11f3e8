// SPDX-License-Identifier: GPL-3.0-or-later
// What an earlier run of the same cell found out and this one need not: CalibrateOptions::known.
#pragma once

#include <optional>
#include <string>

#include "run.h"

namespace servocal::procedure {

/// Takes over mount and tilt limits; what the session already holds of them goes first.
/// @throws Error (kBadData) if the earlier result has no mount, or one of another kind, or another board.
void believeKnown(Run& run, const CalibrationResult& known);

/// A sentence if the board is not mounted as the earlier run found it.
std::optional<std::string> mountChanged(const CalibrationResult& known, const CalibrationResult& now);

}  // namespace servocal::procedure
