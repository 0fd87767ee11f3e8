// SPDX-License-Identifier: GPL-3.0-or-later
#include <fstream>
#include <functional>
#include <iterator>
#include <set>

#include "durable_file.h"
#include "layout.h"
#include "salvage.h"
#include "servocal/session/check.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;

fs::path freeBackupFolder(const fs::path& folder) {
  for (int number = 1;; ++number) {
    const fs::path backup = folder / ("backup-" + std::to_string(number));
    std::error_code ignored;
    if (!fs::exists(backup, ignored)) return backup;
  }
}

void copyDurably(const fs::path& from, const fs::path& to) {
  std::ifstream in(from, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  writeWhole(to, bytes.data(), bytes.size());
}

class Repair {
 public:
  explicit Repair(const fs::path& folder) : folder_(folder) {}

  SessionRepair run() {
    if (!isSession(folder_)) throw noSession(folder_);
    const FileLock lock(folder_ / "session.lock");
    if (const SessionCheck check = checkSession(folder_); check.whole()) {
      repair_.observations = check.observations;
      return repair_;
    }
    const fs::path file = databaseFile(folder_), rebuilt = file.string() + ".repaired";
    makeBackup(file);
    {
      const auto old = openDatabase(folder_, Database::Access::kWrite);
      attempt("", [&] { old->execute("REINDEX"); });  // A damaged index would hide rows.
      fs::remove(rebuilt);
      const Database fresh(rebuilt, Database::Access::kCreate);
      fresh.execute("PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON;");
      Transaction transaction(fresh);
      copy(*old, fresh);
      transaction.commit();
    }
    // The log belongs to the old file; with the new one it would be replayed into it.
    for (const char* ending : {"-wal", "-shm"}) fs::remove(file.string() + ending);
    fs::rename(rebuilt, file);
    syncFolder(folder_);
    return std::move(repair_);
  }

 private:
  void attempt(const std::string& what, const std::function<void()>& part) {
    try {
      part();
    } catch (const Error& error) {
      if (!what.empty()) repair_.dropped.push_back(what + ": " + error.what());
    }
  }

  void makeBackup(const fs::path& file) {
    repair_.backup = freeBackupFolder(folder_);
    makeFolder(repair_.backup / "images");
    for (const char* ending : {"", "-wal"}) {
      std::error_code ignored;
      const fs::path from = file.string() + ending;
      if (fs::exists(from, ignored)) copyDurably(from, repair_.backup / from.filename());
    }
    syncFolder(repair_.backup);
  }

  void copy(const Database& old, const Database& fresh) {
    makeTables(fresh);
    attempt("table meta", [&] {
      Statement rows(old, "SELECT key, value FROM meta WHERE key <> 'schema_version'");
      while (rows.step()) putMeta(fresh, rows.text(0).c_str(), rows.text(1));
    });
    ObservationReader reader(old);
    std::set<std::int64_t> kept;
    for (const std::int64_t id : reachableIds(old, "observation")) {
      attempt("observation " + std::to_string(id), [&] {
        Observation observation = reader.read(id);
        if (auto what = objection(observation)) throw Error(ErrorKind::kBadData, *what);
        const ImageHashes hashes = reader.hashes(id);
        takeOutDamagedImages(observation, hashes);
        insertObservation(fresh, observation, hashes);
        kept.insert(id);
      });
    }
    repair_.observations = static_cast<int>(kept.size());
    for (const std::int64_t id : reachableIds(old, "attempt")) {
      attempt("attempt " + std::to_string(id), [&] {
        for (Attempt& made : selectAttempts(old, id)) {
          if (made.observation_id && kept.count(*made.observation_id) == 0) made.observation_id.reset();
          insertAttempt(fresh, made);
        }
      });
    }
    for (const std::int64_t id : reachableIds(old, "event")) {
      attempt("event " + std::to_string(id), [&] {
        for (const SessionEvent& event : selectEvents(old, id)) insertEvent(fresh, event);
      });
    }
  }

  void takeOutDamagedImages(Observation& observation, const ImageHashes& hashes) {
    for (std::string* name : imageFiles(observation)) {
      const auto hash = hashes.find(*name);
      const auto what = imageObjection(folder_ / *name, hash == hashes.end() ? "" : hash->second);
      if (!what) continue;
      repair_.dropped.push_back("observation " + std::to_string(observation.id) + ": " + *what +
                                "; its corners are kept");
      std::error_code ignored;  // It may not be there.
      fs::rename(folder_ / *name, repair_.backup / *name, ignored);
      name->clear();
    }
  }

  fs::path folder_;
  SessionRepair repair_;
};

}  // namespace

SessionRepair repairSession(const fs::path& folder) { return Repair(folder).run(); }

}  // namespace servocal::session
