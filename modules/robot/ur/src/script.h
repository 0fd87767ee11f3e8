// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"

namespace servocal::robot::ur {

/// What is filled into data/servo.script.
struct ScriptOptions {
  MotionLimits limits;
  double tcp_lever_m = 0.0;  ///< Distance of the active TCP from the flange; it moves that much faster.
  Duration watchdog{};       ///< Silence after which the controller ends the program.
  double rate_hz = 125.0;
  int token = 0;
};

/// The heartbeat test inside the script strikes a little before the controller's watchdog: braking along the
/// path is gentler than ending the program.
constexpr double kHeartbeatShare = 0.8;

/// The program to upload: starts with "def" in column 0 and ends with "end" and a line break, as the
/// controller demands.
std::string servoScript(const ScriptOptions& options);

}  // namespace servocal::robot::ur
