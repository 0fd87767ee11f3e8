// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app/main.h"

#include <cstring>
#include <iostream>
#include <new>

#include "servocal/core/error.h"

namespace servocal::app {
namespace {

constexpr const char* kExitCodes =
    "\nExit codes: 0 goal met, 1 internal error or out of memory, 2 usage, 3 invalid configuration,\n"
    "4 finished but goal not met, 5 hardware absent, 6 safety stop, 7 interrupted, 8 data unreadable or\n"
    "inconsistent, or disk full, 9 refused to move.";

int exitCode(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kNothingToDo: return kUsage;
    case ErrorKind::kInvalidConfig: return kInvalidConfig;
    case ErrorKind::kHardwareAbsent: return kHardwareAbsent;
    case ErrorKind::kSafetyStop: return kSafetyStop;
    case ErrorKind::kInterrupted: return kInterrupted;
    case ErrorKind::kBadData: return kBadData;
    case ErrorKind::kRefusedToMove: return kRefusedToMove;
  }
  return kInternalError;
}

/// OpenCV has an error of its own for memory that it did not get.
bool isOutOfMemory(const std::exception& error) {
  return dynamic_cast<const std::bad_alloc*>(&error) != nullptr ||
         std::strstr(error.what(), "Insufficient memory") != nullptr;
}

}  // namespace

int guardedMain(CLI::App& cli, int argc, char** argv, const std::function<int()>& body) {
  cli.footer(cli.get_footer() + kExitCodes);
  cli.set_version_flag("--version", SERVOCAL_VERSION);
  try {
    cli.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return cli.exit(error) == 0 ? kOk : kUsage;
  }
  try {
    return body();
  } catch (const Error& error) {
    std::cerr << cli.get_name() << ": " << error.what() << '\n';
    return exitCode(error.kind());
  } catch (const std::exception& error) {
    if (isOutOfMemory(error)) {
      std::cerr << cli.get_name()
                << ": out of memory; what was stored before is safe, close other programs and start again\n";
    } else {
      std::cerr << cli.get_name() << ": internal error: " << error.what() << '\n';
    }
    return kInternalError;
  }
}

}  // namespace servocal::app
