// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <sys/types.h>

#include "motion_record.h"
#include "servocal/core/cell_config.h"

namespace servocal::sim {

/// The simulated controller in a process of its own. It ends with this object, or by itself after this
/// process.
class ControllerProcess {
 public:
  /// @throws Error (kHardwareAbsent) if no process, memory or port can be had.
  ControllerProcess(const ArmConfig& arm, std::uint64_t seed);
  ~ControllerProcess();
  ControllerProcess(const ControllerProcess&) = delete;
  ControllerProcess& operator=(const ControllerProcess&) = delete;

  const UrConfig& address() const { return address_; }
  const MotionRecord& record() const { return *record_; }

 private:
  UrConfig address_;
  MotionRecord* record_ = nullptr;  ///< Shared with the controller's process.
  pid_t process_ = -1;
  int lifeline_ = -1;  ///< The other end reads nothing until it is closed, by us or by our death.
};

}  // namespace servocal::sim
