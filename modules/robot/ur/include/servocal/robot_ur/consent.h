// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "servocal/core/cell_config.h"
#include "servocal/robot_ur/arm.h"

namespace servocal::robot::ur {

/// What the operator reads before a real arm moves: which arm, how fast, where it will not go, and what is
/// not proven. Ends with what to type; Arm::arm() takes the answer.
std::string consentText(const ControllerFacts& facts, const MotionLimits& limits);

}  // namespace servocal::robot::ur
