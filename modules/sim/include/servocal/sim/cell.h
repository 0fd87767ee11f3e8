// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/robot/arm.h"
#include "servocal/sensor/rgbd_camera.h"
#include "servocal/sim/arm_motion.h"

namespace servocal::sim {

/// A simulated robot cell: an arm holding a board and cameras that see it, or the other way round, all on one
/// simulated clock.
/// It hands out what hardware would, images and robot states, and nothing else. Every random draw comes
/// from `seed`. Same seed and same calls, same run.
///
/// Time passes only by the clock: who sleeps on it or waits for a frame moves it on. What the arm and the
/// cameras did meanwhile is worked out when somebody asks; a frame that nobody reads is not rendered.
/// For one thread.
///
/// The arm reports nominal kinematics; its flange really is elsewhere, by the configured accuracy (drawn
/// once per seed) and repeatability (another at each visit). A joint that reaches its limit is a protective
/// stop: state() throws from then on. Cameras deliver color and infrared as CV_8UC1, the scene is without
/// color, and depth as CV_16UC1 (mm, 0: nothing measured); `device_stamp_s` of arm and cameras are each on a clock
/// of their own. SimulationConfig::faults happen.
class Cell {
 public:
  /// @throws std::invalid_argument if `config.simulation` is missing, a camera has no counterpart there, cameras
  ///   are both fixed and on the flange, a fault names a camera that is not there, or arm.start_q is not one angle
  ///   per joint within the limits; Error (kInvalidConfig) if the arm's URDF file is no such chain.
  Cell(const CellConfig& config, std::uint64_t seed);
  /// The cameras of a cell whose arm is simulated elsewhere and moves by `clock`, e.g. at the pace of the wall
  /// clock. Its flange is off what its controller believes as it would be here. Both must outlive the cell.
  /// @throws as above.
  Cell(const CellConfig& config, std::uint64_t seed, Clock& clock, ArmMotion& motion);
  ~Cell();
  Cell(Cell&&) noexcept;

  Clock& clock();
  /// @throws std::invalid_argument if the arm is simulated elsewhere.
  robot::Arm& arm();
  /// @throws std::invalid_argument if there is no such camera.
  sensor::RgbdCamera& camera(const std::string& name);

 private:
  friend class Truth;  // test-only, see tests/support
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::sim
