// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>

#include "rtde_fields.h"

namespace servocal::robot::ur {

/// What must stay as it was.
struct Expected {
  Vector6d tcp_offset = Vector6d::Zero();
  double payload_kg = 0.0;
  int token = 0;            ///< Of our program; 0: it need not run.
  int epoch = 0;            ///< That armed it; 0: not armed.
  double watchdog_s = 0.1;  ///< Within which it must give a sign of life once armed.
};

/// A sentence for the operator why the arm must not move, or move on; nothing if it may. `echo_age_s`: how
/// long, by the controller's clock, the program's sign of life has not changed.
std::optional<std::string> objection(const ControllerState& state, const Expected& expected,
                                     double echo_age_s);

}  // namespace servocal::robot::ur
