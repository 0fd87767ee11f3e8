// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <stdexcept>
#include <string>

namespace servocal {

/// Why the world refused. Each kind is one exit code of the apps.
enum class ErrorKind {
  kNothingToDo,      ///< Exit 2: a usage error found after parsing, e.g. an empty folder.
  kInvalidConfig,    ///< Exit 3: cell file, board file or manifest is malformed.
  kHardwareAbsent,   ///< Exit 5: arm or camera not there or unsuited.
  kSafetyStop,       ///< Exit 6: the guard or the arm stopped the motion.
  kInterrupted,      ///< Exit 7: the operator stopped the run.
  kBadData,          ///< Exit 8: data unreadable or inconsistent, or disk full.
  kRefusedToMove,    ///< Exit 9: a precondition of motion is not met.
};

/// The world (a file, a device, the robot) refused. The message is one or two sentences for the
/// operator: what happened, the evidence, what to do. A caller's mistake is std::invalid_argument.
class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

}  // namespace servocal
