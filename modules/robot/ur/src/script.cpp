// SPDX-License-Identifier: GPL-3.0-or-later
#include "script.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <stdexcept>

#include "script_text.h"

namespace servocal::robot::ur {
namespace {

// The guard ramps commands; the controller must follow them, and brake harder than the guard plans to.
constexpr double kAccelerationShare = 2.0;
// The guard's own rounding must never meet the script's limit.
constexpr double kSpeedShare = 1.05;

// With '.', whatever the locale says.
std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6f", value);
  for (char* c = text; *c != '\0'; ++c) {
    if (*c == ',') *c = '.';
  }
  return text;
}

}  // namespace

std::string servoScript(const ScriptOptions& options) {
  const MotionLimits& limits = options.limits;
  const double watchdog_s = toSeconds(options.watchdog);
  const double speed = limits.max_speed_mps + limits.max_angular_speed_radps * options.tcp_lever_m;
  const double braking_s = std::max({speed / limits.max_acceleration_mps2,
                                     limits.max_angular_speed_radps / limits.max_angular_acceleration_radps2,
                                     limits.max_joint_speed_radps / limits.max_angular_acceleration_radps2}) *
                           kSpeedShare / kAccelerationShare;
  const std::map<std::string, std::string> values = {
      {"WATCHDOG_HZ", number(1.0 / watchdog_s)},
      {"HEARTBEAT_TIMEOUT_S", number(kHeartbeatShare * watchdog_s)},
      // At most two heartbeats per package and step are sent, so this many are a pause of at least half the
      // watchdog's time.
      {"MAX_BEAT_LEAP", std::to_string(static_cast<int>(std::ceil(watchdog_s * options.rate_hz)))},
      {"BRAKING_S", number(braking_s)},
      {"TOKEN", std::to_string(options.token)},
      {"MAX_SPEED_MPS", number(kSpeedShare * speed)},
      {"MAX_ANGULAR_SPEED_RADPS", number(kSpeedShare * limits.max_angular_speed_radps)},
      {"MAX_JOINTS_RADPS", number(kSpeedShare * std::sqrt(6.0) * limits.max_joint_speed_radps)},
      {"ACCELERATION_MPS2", number(kAccelerationShare * limits.max_acceleration_mps2)},
      {"ACCELERATION_RADPS2", number(kAccelerationShare * limits.max_angular_acceleration_radps2)},
      {"JOINT_ACCELERATION_RADPS2", number(kAccelerationShare * limits.max_angular_acceleration_radps2)},
  };
  std::string script = kServoScript;
  for (std::size_t at; (at = script.find("{{")) != std::string::npos;) {
    const std::size_t end = script.find("}}", at);
    const auto value = values.find(script.substr(at + 2, end - at - 2));
    if (value == values.end()) throw std::logic_error("servo.script asks for a number nobody knows");
    script.replace(at, end + 2 - at, value->second);
  }
  return script;
}

}  // namespace servocal::robot::ur
