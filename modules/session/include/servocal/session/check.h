// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "servocal/session/session.h"

namespace servocal::session {

/// What is left of a session.
struct SessionCheck {
  int observations = 0;  ///< That can be read.
  int images = 0;        ///< That are as they were stored.
  std::vector<std::string>
      damage;  ///< A sentence each; empty: every observation can be read, every image is whole.
  std::vector<std::string> notes;  ///< Nothing is wrong, but a person may want to know; a sentence each.
  bool whole() const { return damage.empty(); }
};

/// Reads a session through: the database's own integrity, every observation and attempt, every image against
/// its hash (in sessions of before schema 4: that it is no truncated file). Also while it is being written.
///
/// Not seen: a number in the database that was changed without breaking its structure.
/// @throws Error (kBadData) if the folder holds no session.
SessionCheck checkSession(const std::filesystem::path& folder);

struct SessionRepair {
  std::filesystem::path backup;  ///< Folder with the database as it was, and the images taken out. Empty:
                                 ///< there was nothing to repair, and nothing was changed.
  std::vector<std::string> dropped;  ///< What could not be saved, a sentence each.
  int observations = 0;              ///< Saved.
};

/// Rebuilds the database from what can still be read. Observations that cannot are dropped; of one whose
/// image is damaged the corners are kept and the image is taken out. The old database is copied into the
/// session's folder first, as backup-1, backup-2, ... One of an older schema becomes one of this.
/// @throws Error (kBadData) if there is no session, it is being written, the disk refuses, or the database
/// cannot
///   be opened at all.
SessionRepair repairSession(const std::filesystem::path& folder);

/// A page for a person: who wrote it, what was observed and tried, how it ended. Ends with a newline.
std::string describeSession(const Session& session);

}  // namespace servocal::session
