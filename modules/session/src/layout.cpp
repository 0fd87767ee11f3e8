// SPDX-License-Identifier: GPL-3.0-or-later
#include "layout.h"

#include "schema.h"
#include "servocal/session/session.h"

namespace servocal::session {

namespace fs = std::filesystem;

fs::path databaseFile(const fs::path& folder) { return folder / "session.sqlite"; }

Error noSession(const fs::path& folder) {
  return Error(ErrorKind::kBadData, "folder '" + folder.string() + "' holds no session (no session.sqlite)");
}

std::unique_ptr<Database> openDatabase(const fs::path& folder, Database::Access access) {
  if (!isSession(folder)) throw noSession(folder);
  auto database = std::make_unique<Database>(databaseFile(folder), access);
  if (!database->hasTable("meta")) {
    throw Error(ErrorKind::kBadData, "session '" + folder.string() +
                                         "' is empty: its program ended before it could store anything");
  }
  const int version = schemaVersion(*database);
  if (version < kOldestReadable || version > kSchemaVersion) {
    throw Error(ErrorKind::kBadData, "session '" + folder.string() + "' has schema version " +
                                         std::to_string(version) + ", this program reads " +
                                         std::to_string(kOldestReadable) + " to " +
                                         std::to_string(kSchemaVersion));
  }
  return database;
}

void makeDurable(const Database& database) {
  database.execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON;");
}

void makeTables(const Database& database) {
  database.execute(kTables);
  database.execute(kDepthTables);
  putMeta(database, "schema_version", std::int64_t{kSchemaVersion});
}

void migrate(const Database& database) {
  const int version = schemaVersion(database);
  if (version == kSchemaVersion) return;
  Transaction transaction(database);
  if (version < 3) {
    database.execute(kDepthTables);
    database.execute("ALTER TABLE view ADD COLUMN image_sha256 TEXT NOT NULL DEFAULT ''");
  } else if (version < 4) {
    database.execute(kAddHashes);
  }
  putMeta(database, "schema_version", std::int64_t{kSchemaVersion});
  transaction.commit();
}

int schemaVersion(const Database& database) {
  Statement query(database, "SELECT value FROM meta WHERE key = 'schema_version'");
  return query.step() ? static_cast<int>(query.integer(0)) : 0;
}

std::optional<std::string> metaText(const Database& database, const char* key) {
  Statement query(database, "SELECT value FROM meta WHERE key = ?");
  query.bind(std::string(key));
  if (!query.step()) return std::nullopt;
  return query.text(0);
}

}  // namespace servocal::session
