// SPDX-License-Identifier: GPL-3.0-or-later
// What can be read of a session, and what is wrong with the rest.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "rows.h"

namespace servocal::session {

/// The ids of a table's rows, rising; of a damaged table those that can be reached from either end.
std::vector<std::int64_t> reachableIds(const Database& database, const std::string& table);

/// What is wrong with an observation that could be read; nothing if all is well.
std::optional<std::string> objection(const Observation& observation);

/// What is wrong with an image file; nothing if it is as it was stored.
/// @param sha256 empty: unknown, the file need only be whole.
std::optional<std::string> imageObjection(const std::filesystem::path& file, const std::string& sha256);

/// The image files of an observation that were kept.
std::vector<std::string*> imageFiles(Observation& observation);

}  // namespace servocal::session
