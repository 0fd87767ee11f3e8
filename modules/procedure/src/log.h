// SPDX-License-Identifier: GPL-3.0-or-later
// Lines in the session's log that tell a run's course; docs/session-format.md lists all kinds.
#pragma once

#include <exception>

#include "run.h"

namespace servocal::procedure {

constexpr const char *kBegin = "begin", *kStage = "stage", *kEnd = "end", *kInterrupted = "interrupted",
                     *kFault = "fault";

/// A run begins, or goes on. The clock starts at zero again; the line says after which drive, so that those of both
/// parts can be told apart.
void noteBegin(Run& run, const session::Session& session);

/// What broke a run off. Never throws: the error itself is what must be told, and it may be the disk's.
void noteBrokenOff(Run& run, const std::exception& error) noexcept;

}  // namespace servocal::procedure
