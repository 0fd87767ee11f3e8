// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "arm_model.h"
#include "script_machine.h"
#include "servocal/sim_ur_controller/ur_controller.h"

namespace servocal::sim {

/// What all servers of the controller share. One thread.
struct ControllerState {
  explicit ControllerState(const UrControllerOptions& given)
      : options(given), arm(given.start_q, given.tcp_offset, given.seed, given.kinematic_error_m) {}

  struct Watchdog {
    std::string variable;
    double period_s = 0.0;
    std::string action;
    double fed_s = 0.0;
  };

  bool has(UrFault fault) const { return faults.count(fault) > 0; }
  bool eSeries() const { return options.major >= 5; }
  double period() const { return eSeries() ? 0.002 : 0.008; }
  bool stoppedForSafety() const {
    return has(UrFault::kProtectiveStop) || has(UrFault::kEmergencyStop) || has(UrFault::kPowerOff);
  }
  bool paused() const { return has(UrFault::kProgramPaused) || stoppedForSafety(); }
  double slider() const { return has(UrFault::kSliderZero) ? 0.0 : has(UrFault::kSliderHalf) ? 0.5 : 1.0; }

  const UrControllerOptions options;
  std::set<UrFault> faults;
  double time_s = 5000.0;
  ArmModel arm;
  std::map<int, std::int32_t> input_integers;
  std::map<int, double> input_floats;
  std::map<int, std::int32_t> output_integers;
  std::set<std::string> fresh_inputs;  ///< Variables that came since the last step.
  std::vector<Watchdog> watchdogs;
  std::unique_ptr<ScriptMachine> program;
  std::vector<std::string> messages;  ///< Waiting for the primary clients, packed.
  double last_input_s = 0.0;
  double last_moving_input_s = 0.0;
  double last_motion_s = 0.0;
  bool watchdog_struck = false;
  std::string program_text;
};

}  // namespace servocal::sim
