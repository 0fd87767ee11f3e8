// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/robot/arm.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::sim {

/// A simulated robot cell: an arm holding a board, and cameras that see it, all on one simulated clock.
/// It hands out what hardware would, images and robot states, and nothing else. Every random draw comes
/// from `seed`. Same seed and same calls, same run.
class Cell {
 public:
  /// @throws std::invalid_argument if `config.simulation` is missing or a camera has no counterpart there.
  Cell(const CellConfig& config, std::uint64_t seed);
  ~Cell();
  Cell(Cell&&) noexcept;

  Clock& clock();
  robot::Arm& arm();
  /// @throws std::invalid_argument if there is no such camera.
  sensor::RgbdCamera& camera(const std::string& name);

 private:
  friend class Truth;  // test-only, see tests/support
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::sim
