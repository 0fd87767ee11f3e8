// SPDX-License-Identifier: GPL-3.0-or-later
// The database of a session: where it is, its versions.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "database.h"
#include "servocal/core/error.h"

namespace servocal::session {

std::filesystem::path databaseFile(const std::filesystem::path& folder);

Error noSession(const std::filesystem::path& folder);

/// Opens a session's database of any readable version.
/// @throws Error (kBadData) if there is none, it cannot be read, is empty or of another version.
std::unique_ptr<Database> openDatabase(const std::filesystem::path& folder, Database::Access access);

/// What is committed afterwards survives.
void makeDurable(const Database& database);
/// An empty session of the present version, inside the caller's transaction.
void makeTables(const Database& database);
/// From any readable version to the present one, whole or not at all.
void migrate(const Database& database);
int schemaVersion(const Database& database);

template <class Value>
void putMeta(const Database& database, const char* key, const Value& value) {
  Statement(database, "INSERT OR REPLACE INTO meta VALUES (?, ?)").bind(std::string(key)).bind(value).run();
}
/// Nothing if it is not there.
std::optional<std::string> metaText(const Database& database, const char* key);

}  // namespace servocal::session
