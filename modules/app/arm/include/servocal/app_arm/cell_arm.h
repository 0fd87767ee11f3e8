// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/robot/arm.h"
#include "servocal/sim/cell.h"

namespace servocal::app {

struct ArmOptions {
  bool arm = false;        ///< --arm was given: a real arm may move, once the operator has consented.
  std::uint64_t seed = 1;  ///< Of what is simulated.
};

/// The arm of a cell, through the driver that the cell file names (ArmConfig::backend), the run's clock, and
/// the simulation the cameras belong to, if it is simulated.
///
/// An arm of the backend `ur` is connected to, which reads only, and cannot move before askConsent(). If its
/// `host` is this computer and the cell has a simulation section, the program starts a simulated controller
/// there (sim::UrCell); everything else is as with a real one. That is a process of its own, so the arm must
/// be opened before the program has threads.
class CellArm {
 public:
  /// `cell` must outlive it.
  /// @throws Error kRefusedToMove before anything is connected to: a real arm without ArmOptions::arm, or
  ///   without a terminal where the operator could consent; kNothingToDo for ArmOptions::arm with an arm that
  ///   is simulated; and as ur::Arm and sim::Cell.
  CellArm(const CellConfig& cell, const ArmOptions& options);
  /// A real arm is braked, and its program ended.
  ~CellArm();
  CellArm(const CellArm&) = delete;
  CellArm& operator=(const CellArm&) = delete;

  Clock& clock();
  robot::Arm& device();
  /// Nothing if arm and cameras are real.
  sim::Cell* simulation();

  /// Shows the operator which arm is going to move, how fast and where, and takes the serial number typed for
  /// consent. Nothing to do for an arm of the backend `sim`. To be called last before the run: the arm may
  /// move from then on.
  /// @throws Error kRefusedToMove if something else is typed, or nothing; and as ur::Arm::arm().
  void askConsent();

  /// What the result says of where it comes from: "simulated cell 'x', seed 1", "cell 'x', UR5 2014350123 at
  /// ...".
  std::string provenance() const;
  /// For the operator at the start: what nobody has proven, what of the cell file does not count.
  const std::vector<std::string>& notes() const;
  /// For the session's log, at the end of a run: what the controller said of itself and of the link.
  std::vector<std::string> record() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::app
