// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/sim/cell.h"

namespace servocal::sim {

/// A simulated cell whose arm is reached as a real one is: over the network, at a Universal Robots
/// controller. The controller (sim_ur_controller) is a process of its own, so that it goes on when this
/// program dies and does with the arm what a controller does then. The cell's cameras see the arm where that
/// controller moved it. Everything happens at the pace of the wall clock.
///
/// What goes from the controller's process to the cameras is the motion alone; nobody else gets it. The
/// controller's arm is some millimetres off its nominal geometry, which its controller knows, and off what
/// its controller knows by the cell's own accuracy and repeatability.
///
/// When this process dies, the controller waits until its arm stands, says on the standard error output how
/// long it moved on if it was moving, and ends.
class UrCell {
 public:
  /// Starts the controller by fork(), so it must come before this process has threads. The arm has the serial
  /// number that the cell names and stands at its start.
  /// @throws std::invalid_argument if the cell has no simulation or its arm is not of the backend kUr;
  ///   Error (kInvalidConfig) if the arm is not the built-in UR5; (kHardwareAbsent) if no process can be had.
  UrCell(const CellConfig& config, std::uint64_t seed, Clock& clock);
  ~UrCell();
  UrCell(const UrCell&) = delete;
  UrCell& operator=(const UrCell&) = delete;

  Cell& cell();
  /// Where the controller is reached: loopback and ports of its own, whatever the cell file says.
  const UrConfig& address() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::sim
