// SPDX-License-Identifier: GPL-3.0-or-later
// A simulated controller, a clock, and the driver connected to it.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "cells.h"
#include "errors.h"
#include "motion_key.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/robot_ur/arm.h"
#include "servocal/sim_ur_controller/ur_controller.h"

namespace servocal::test {

using sim::UrController;
using sim::UrControllerOptions;
using sim::UrControllerTruth;
using sim::UrFault;

/// Times that a busy computer does not break. Tests of the times themselves use the driver's own.
inline robot::ur::ArmOptions patient() {
  robot::ur::ArmOptions options;
  options.watchdog = std::chrono::milliseconds(600);
  options.dead_peer = std::chrono::milliseconds(500);
  options.reply_timeout = std::chrono::seconds(5);
  return options;
}

class UrCell {
 public:
  explicit UrCell(const UrControllerOptions& options = {}) : controller(options) {
    config.backend = ArmBackend::kUr;
    config.ur = UrConfig{"127.0.0.1", options.serial, controller.rtdePort(), controller.dashboardPort(),
                         controller.programPort()};
  }

  std::unique_ptr<robot::ur::Arm> connected(const robot::ur::ArmOptions& options = patient()) {
    return std::make_unique<robot::ur::Arm>(config, limits, clock, options);
  }
  std::unique_ptr<robot::ur::Arm> armed(const robot::ur::ArmOptions& options = patient()) {
    auto arm = connected(options);
    arm->arm(config.ur->serial);
    return arm;
  }
  bool waitFor(const std::function<bool()>& condition, double seconds = 10.0) {
    const Instant give_up = clock.now() + fromSeconds(seconds);
    while (!condition()) {
      if (clock.now() > give_up) return false;
      clock.sleepFor(std::chrono::milliseconds(1));
    }
    return true;
  }
  bool stands() const { return controller.truth().joint_speed_radps < 1e-6; }

  /// Commands the twist every 8 ms until `condition` or an Error, which is returned.
  std::optional<Error> drive(robot::ur::Arm& arm, const Twist<Base>& twist,
                             const std::function<bool()>& condition, double seconds = 10.0) {
    const Instant give_up = clock.now() + fromSeconds(seconds);
    try {
      while (!condition() && clock.now() < give_up) {
        arm.state();
        arm.move(forgedMotionKey(), twist, std::chrono::milliseconds(400));
        clock.sleepFor(std::chrono::milliseconds(8));
      }
    } catch (const Error& error) {
      return error;
    }
    return std::nullopt;
  }
  bool moves() const { return controller.truth().tcp_speed_mps > 0.9 * up().linear_mps.norm(); }
  static Twist<Base> up() { return {{0.0, 0.0, 0.05}, Eigen::Vector3d::Zero()}; }

  UrController controller;
  WallClock clock;
  ArmConfig config;
  MotionLimits limits = oneCameraCell().limits;
};

}  // namespace servocal::test
