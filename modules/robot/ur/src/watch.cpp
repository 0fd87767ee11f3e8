// SPDX-License-Identifier: GPL-3.0-or-later
#include "watch.h"

#include <cstdio>

namespace servocal::robot::ur {
namespace {

constexpr double kSameM = 1e-5;  // Of the TCP offset and its rotation vector; the controller only rounds.
constexpr double kSameKg = 1e-3;
constexpr double kSliderAtZero = 0.005;  // The pendant's slider goes in steps of 1 %.
constexpr char kThenAgain[] = " Put it right at the pendant, then start again.";

std::optional<std::string> safetyObjection(int safety_mode) {
  switch (safety_mode) {
    case kSafetyNormal:
    case kSafetyReduced: return std::nullopt;
    case 3:
      return "The arm made a protective stop. Look what it touched or why it was overloaded, release the "
             "stop at "
             "the pendant (this program never does that by itself), then start again.";
    case 4:
      return std::string("The arm is in recovery mode: a joint or the tool is outside its safety limits.") +
             kThenAgain;
    case 5:
      return std::string("The arm stands in a safeguard stop: a gate or light curtain is open.") + kThenAgain;
    case 6:
    case 7: return std::string("The emergency stop is pressed.") + kThenAgain;
    case 8:
    case 9:
      return "The controller reports a safety violation or fault (safety mode " +
             std::to_string(safety_mode) + "). Read its log at the pendant before anything else.";
    default:
      return "The controller's safety mode is " + std::to_string(safety_mode) +
             ", neither normal nor reduced." + kThenAgain;
  }
}

}  // namespace

std::optional<std::string> objection(const ControllerState& state, const Expected& expected,
                                     double echo_age_s) {
  if (auto safety = safetyObjection(state.safety_mode)) return safety;
  if (state.robot_mode != kRobotModeRunning) {
    return "The arm is not running (robot mode " + std::to_string(state.robot_mode) +
           "): power it on and release the brakes at the pendant, then start again.";
  }
  if (state.teachButton()) return "The teach button (freedrive) is pressed. Let go of it, then start again.";
  if (state.speed_slider < kSliderAtZero) {
    return "The speed slider on the pendant stands at 0 %, so the arm cannot follow. Move it up, then start "
           "again.";
  }
  if (!(state.tcp_offset - expected.tcp_offset).isZero(kSameM)) {
    return "The active TCP was changed on the controller, so poses before and after do not fit together. Set "
           "it "
           "back, then start again.";
  }
  if (std::abs(state.payload_kg - expected.payload_kg) > kSameKg) {
    char text[160];
    std::snprintf(
        text, sizeof text,
        "The payload on the controller was changed from %.3f to %.3f kg, which bends the arm differently. "
        "Set it back, then start again.",
        expected.payload_kg, state.payload_kg);
    return text;
  }
  if (expected.token == 0) return std::nullopt;
  if (!state.programRuns()) {
    return "Our program on the controller was paused or stopped: at the pendant, or by the controller's "
           "watchdog "
           "because this computer was silent for too long. The arm stands. Start again.";
  }
  if (state.script_token != expected.token || (expected.epoch != 0 && echo_age_s > expected.watchdog_s)) {
    return "Another program runs on the controller in place of ours. Stop it, then start again.";
  }
  if (expected.epoch != 0 && (state.script_state != 2 || state.script_epoch != expected.epoch)) {
    return "Our program on the controller stopped the arm because the heartbeat of this computer stood still "
           "for "
           "too long. See that nothing else overloads this computer, then start again.";
  }
  return std::nullopt;
}

}  // namespace servocal::robot::ur
