// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/session/check.h"

#include <functional>
#include <set>

#include "layout.h"
#include "salvage.h"
#include "schema.h"
#include "servocal/core/config_reader.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostSentences = 20;  // of one kind

class Checker {
 public:
  explicit Checker(const fs::path& folder) : folder_(folder) {}

  SessionCheck run() {
    if (!isSession(folder_)) throw noSession(folder_);
    if (!attempt("database", [&] { database_ = openDatabase(folder_, Database::Access::kRead); }))
      return check_;
    attempt("database", [&] { checkStructure(); });
    attempt("board", [&] {
      readBoard(ConfigReader::fromText(metaText(*database_, "board_text").value_or(""),
                                       "board_text in table meta"));
    });
    attempt("database", [&] { checkObservations(); });
    attempt("database", [&] { checkAttempts(); });
    noteLeftovers();
    if (const int version = schemaVersion(*database_); version < kSchemaVersion) {
      check_.notes.push_back("schema version " + std::to_string(version) + ", the present one is " +
                             std::to_string(kSchemaVersion) +
                             "; it is read as it is, and rewritten when resumed");
    }
    return std::move(check_);
  }

 private:
  /// False if the database could not be read there.
  bool attempt(const std::string& what, const std::function<void()>& part) {
    try {
      part();
      return true;
    } catch (const Error& error) {
      check_.damage.push_back(what + ": " + error.what());
      return false;
    }
  }

  void checkStructure() {
    Statement integrity(*database_,
                        ("PRAGMA integrity_check(" + std::to_string(kMostSentences) + ")").c_str());
    while (integrity.step()) {
      if (integrity.text(0) != "ok") check_.damage.push_back("database: " + integrity.text(0));
    }
    std::set<std::string> orphans;
    Statement foreign(*database_, "PRAGMA foreign_key_check");
    while (foreign.step()) orphans.insert(foreign.text(0));
    for (const std::string& table : orphans) {
      check_.damage.push_back("database: rows of table '" + table + "' belong to nothing");
    }
  }

  void checkObservations() {
    ObservationReader reader(*database_);
    int unhashed = 0;
    for (const std::int64_t id : reachableIds(*database_, "observation")) {
      attempt("observation " + std::to_string(id), [&] {
        Observation observation = reader.read(id);
        if (auto what = objection(observation)) throw Error(ErrorKind::kBadData, *what);
        ++check_.observations;
        const ImageHashes hashes = reader.hashes(id);
        for (const std::string* file : imageFiles(observation)) {
          named_.insert(*file);
          const auto hash = hashes.find(*file);
          const std::string sha256 = hash == hashes.end() ? "" : hash->second;
          unhashed += sha256.empty();
          if (auto what = imageObjection(folder_ / *file, sha256)) {
            check_.damage.push_back("observation " + std::to_string(id) + ": " + *what);
          } else {
            ++check_.images;
          }
        }
      });
    }
    if (unhashed > 0) {
      check_.notes.push_back(std::to_string(unhashed) +
                             " images have no hash: of them only that they are not truncated is known");
    }
  }

  void checkAttempts() {
    for (const std::int64_t id : reachableIds(*database_, "attempt")) {
      attempt("attempt " + std::to_string(id), [&] { selectAttempts(*database_, id); });
    }
  }

  void noteLeftovers() {
    std::size_t left_over = 0;
    std::error_code ignored;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / "images", ignored)) {
      left_over += named_.count("images/" + entry.path().filename().string()) == 0;
    }
    if (left_over > 0) {
      check_.notes.push_back(
          std::to_string(left_over) +
          " files in images/ belong to no observation; they may be deleted when nobody writes");
    }
  }

  fs::path folder_;
  std::unique_ptr<Database> database_;
  SessionCheck check_;
  std::set<std::string> named_;
};

}  // namespace

SessionCheck checkSession(const fs::path& folder) { return Checker(folder).run(); }

}  // namespace servocal::session
