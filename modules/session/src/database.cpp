// SPDX-License-Identifier: GPL-3.0-or-later
#include "database.h"

#include <cmath>
#include <limits>
#include <new>

#include "servocal/core/error.h"

namespace servocal::session {

Statement::Statement(const Database& database, const char* sql) : database_(database) {
  check(sqlite3_prepare_v2(database.handle(), sql, -1, &statement_, nullptr));
}

Statement::~Statement() { sqlite3_finalize(statement_); }

void Statement::check(int code) const {
  if (code != SQLITE_OK && code != SQLITE_ROW && code != SQLITE_DONE) database_.refuse(code);
}

Statement& Statement::bind(std::int64_t value) {
  check(sqlite3_bind_int64(statement_, ++parameter_, value));
  return *this;
}

Statement& Statement::bind(double value) {
  check(sqlite3_bind_double(statement_, ++parameter_, value));
  return *this;
}

Statement& Statement::bind(const std::string& value) {
  check(sqlite3_bind_text(statement_, ++parameter_, value.data(), static_cast<int>(value.size()),
                          SQLITE_TRANSIENT));
  return *this;
}

Statement& Statement::bindNull() {
  check(sqlite3_bind_null(statement_, ++parameter_));
  return *this;
}

bool Statement::step() {
  const int code = sqlite3_step(statement_);
  check(code);
  return code == SQLITE_ROW;
}

void Statement::run() {
  while (step()) {
  }
  rewind();
}

void Statement::rewind() {
  check(sqlite3_reset(statement_));
  parameter_ = 0;
}

void Statement::reset() noexcept {
  sqlite3_reset(statement_);
  parameter_ = 0;
}

bool Statement::isNull(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }

std::int64_t Statement::integer(int column) const { return sqlite3_column_int64(statement_, column); }

double Statement::number(int column) const {
  return isNull(column) ? std::numeric_limits<double>::quiet_NaN()
                        : sqlite3_column_double(statement_, column);
}

std::string Statement::text(int column) const {
  const auto* data = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
  if (data == nullptr) return "";
  return std::string(data, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)));
}

namespace {

/// SQLite cannot read a write-ahead log in a folder it may not write to, unless it is told that nobody
/// will change the file. True where that holds: no log is left over.
bool canBeReadAsImmutable(const std::filesystem::path& file) {
  std::error_code ignored;
  const std::filesystem::path log = file.string() + "-wal";
  return !std::filesystem::exists(log, ignored) || std::filesystem::file_size(log, ignored) == 0;
}

std::string immutableUri(const std::filesystem::path& file) {
  std::string uri = "file:";
  for (const char c : file.string()) {
    if (c == '%' || c == '?' || c == '#') {
      constexpr const char* kHex = "0123456789abcdef";
      uri += {'%', kHex[c >> 4], kHex[c & 15]};
    } else {
      uri += c;
    }
  }
  return uri + "?immutable=1";
}

}  // namespace

Database::Database(const std::filesystem::path& file, Access access) : file_(file) {
  int flags = access == Access::kRead ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE;
  if (access == Access::kCreate) flags |= SQLITE_OPEN_CREATE;
  int code = open(file.string(), flags);
  if (code != SQLITE_OK && access == Access::kRead && canBeReadAsImmutable(file)) {
    sqlite3_close(handle_);
    code = open(immutableUri(file), flags | SQLITE_OPEN_URI);
  }
  if (code == SQLITE_OK) return;
  const std::string reason = handle_ != nullptr ? sqlite3_errmsg(handle_) : sqlite3_errstr(code);
  sqlite3_close(handle_);
  throw Error(ErrorKind::kBadData, "cannot open '" + file.string() + "': " + reason);
}

int Database::open(const std::string& name, int flags) {
  handle_ = nullptr;
  const int code = sqlite3_open_v2(name.c_str(), &handle_, flags | SQLITE_OPEN_NOMUTEX, nullptr);
  if (code != SQLITE_OK) return code;
  sqlite3_extended_result_codes(handle_, 1);
  sqlite3_busy_timeout(handle_, 2000);
  // Forces the file to be read, so that one that is no database is refused here.
  return sqlite3_exec(handle_, "SELECT count(*) FROM sqlite_master", nullptr, nullptr, nullptr);
}

Database::~Database() { sqlite3_close(handle_); }

void Database::execute(const char* sql) const {
  const int code = sqlite3_exec(handle_, sql, nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) refuse(code);
}

bool Database::hasTable(const char* name) const {
  Statement query(*this, "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ?");
  query.bind(std::string(name));
  return query.step();
}

bool Database::hasColumn(const char* table, const char* name) const {
  Statement query(*this, "SELECT 1 FROM pragma_table_info(?) WHERE name = ?");
  query.bind(std::string(table)).bind(std::string(name));
  return query.step();
}

void Database::refuse(int code) const {
  if ((code & 0xff) == SQLITE_NOMEM) throw std::bad_alloc();
  std::string message = "'" + file_.string() + "': " + sqlite3_errmsg(handle_);
  if ((code & 0xff) == SQLITE_FULL) {
    message += "; what was stored before is safe, free some space and start again";
  }
  throw Error(ErrorKind::kBadData, message);
}

}  // namespace servocal::session
