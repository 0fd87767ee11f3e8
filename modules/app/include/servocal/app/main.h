// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace servocal::app {

/// Exit codes of every app.
enum ExitCode {
  kOk = 0,              ///< Goal met.
  kInternalError = 1,   ///< Or out of memory.
  kUsage = 2,
  kInvalidConfig = 3,
  kGoalNotMet = 4,      ///< Finished, but the goal is not met.
  kHardwareAbsent = 5,
  kSafetyStop = 6,
  kInterrupted = 7,
  kBadData = 8,         ///< Data unreadable or inconsistent, or disk full.
  kRefusedToMove = 9,
};

/// Parses the command line and runs `body`, the app's work; the one catch-all of every app. Adds the
/// exit codes to the help's foot. Errors become a sentence on stderr and an exit code.
int guardedMain(CLI::App& cli, int argc, char** argv, const std::function<int()>& body);

}  // namespace servocal::app
