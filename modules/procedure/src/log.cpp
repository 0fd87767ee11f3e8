// SPDX-License-Identifier: GPL-3.0-or-later
#include "log.h"

#include <new>

#include "servocal/core/error.h"

namespace servocal::procedure {

void noteBegin(Run& run, const session::Session& session) {
  const std::vector<Attempt> drives = session.attempts();
  run.log(kBegin, std::to_string(drives.empty() ? 0 : drives.back().id));
}

void noteBrokenOff(Run& run, const std::exception& error) noexcept {
  try {
    const auto* const known = dynamic_cast<const Error*>(&error);
    const bool wanted = known != nullptr && known->kind() == ErrorKind::kInterrupted;
    const bool no_memory = dynamic_cast<const std::bad_alloc*>(&error) != nullptr;
    run.log(wanted ? kInterrupted : kFault, no_memory ? "out of memory" : error.what());
  } catch (...) {
  }
}

}  // namespace servocal::procedure
