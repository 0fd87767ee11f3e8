// SPDX-License-Identifier: GPL-3.0-or-later
// What we ask of the controller and what we tell it, as RTDE variables.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "rtde_package.h"

namespace servocal::robot::ur {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// robot_mode, safety_mode and runtime_state as the vendor numbers them; the ones we act on.
constexpr int kRobotModeRunning = 7;
constexpr int kSafetyNormal = 1;
constexpr int kSafetyReduced = 2;
constexpr unsigned kRuntimePlaying = 2;

/// One data package. Lengths m, angles rad, in the controller's base frame.
struct ControllerState {
  double timestamp_s = 0.0;  ///< Since the controller's start.
  Vector6d actual_q = Vector6d::Zero();
  Vector6d actual_tcp_pose = Vector6d::Zero();   ///< Position and rotation vector of the active TCP.
  Vector6d actual_tcp_speed = Vector6d::Zero();  ///< Of the same point, linear part first.
  Vector6d tcp_offset = Vector6d::Zero();        ///< Of the TCP on the flange.
  int robot_mode = 0;
  int safety_mode = 0;
  unsigned robot_status_bits = 0;
  unsigned runtime_state = 0;
  double speed_slider = 0.0;   ///< target_speed_fraction, 0 to 1.
  double speed_scaling = 0.0;  ///< Of the trajectory, by the controller.
  double payload_kg = 0.0;
  int script_state = 0;  ///< output_int_register_24: 0 none, 1 holds, 2 armed.
  int script_epoch = 0;  ///< output_int_register_25
  int script_token = 0;  ///< output_int_register_26
  int script_beat = 0;   ///< output_int_register_27: the last heartbeat it saw.

  bool isFinite() const;
  bool programRuns() const { return runtime_state == kRuntimePlaying; }
  bool teachButton() const { return (robot_status_bits & 4u) != 0; }
};

/// What the script shall do; the value of input_int_register_25.
enum class ScriptMode : std::int32_t { kHold = 0, kTwist = 1, kJoints = 2, kEnd = 3 };

/// One input package: all of it changes together.
struct ScriptInput {
  std::int32_t heartbeat = 0;            ///< input_int_register_24; must change.
  ScriptMode mode = ScriptMode::kHold;   ///< input_int_register_25
  std::int32_t epoch = 0;                ///< input_int_register_26; a new one arms.
  Vector6d velocity = Vector6d::Zero();  ///< input_double_register_24..29: TCP twist, or joint speeds.
};

/// Names and types, in the order of the packages. Registers from 24 on are free of fieldbuses.
std::vector<std::string> outputNames();
std::vector<std::string> inputNames();
/// Throws Error (kRefusedToMove) for a variable that is not there, or that another program owns; of a recipe
/// whose types are not the ones we know, (kHardwareAbsent).
void checkOutputs(const RecipeReply& reply);
void checkInputs(const RecipeReply& reply);

ControllerState decodeState(const Package& package, int recipe_id);
Bytes encodeInput(const ScriptInput& input, int recipe_id);

}  // namespace servocal::robot::ur
