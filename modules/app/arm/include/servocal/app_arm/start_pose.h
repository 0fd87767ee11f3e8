// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/robot/guard.h"

namespace servocal::app {

/// Brings the arm to the cell's start pose, on a way round everything the guard knows of, at half its speed
/// limits. Does nothing if every joint is within a degree of it.
/// @throws Error kRefusedToMove if there is no way, before any motion; kSafetyStop if the arm did not get
///   there; kInterrupted if the operator stopped it; and from the arm.
void goToStart(const CellConfig& cell, robot::Guard& guard, Clock& clock);

}  // namespace servocal::app
