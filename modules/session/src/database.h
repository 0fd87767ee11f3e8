// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace servocal::session {

class Database;

/// A prepared SQL statement; parameters are bound in order, columns read by index.
class Statement {
 public:
  Statement(const Database& database, const char* sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& bind(std::int64_t value);
  Statement& bind(double value);  ///< Not-a-number is stored as NULL.
  Statement& bind(const std::string& value);
  Statement& bindNull();

  /// Runs to the next row; false after the last.
  bool step();
  /// Makes the statement ready for new parameters.
  void rewind();
  /// The same after an error too, which it does not report again.
  void reset() noexcept;
  /// Runs to the end and makes the statement ready for new parameters.
  void run();

  bool isNull(int column) const;
  std::int64_t integer(int column) const;
  double number(int column) const;  ///< NULL is not-a-number.
  std::string text(int column) const;

 private:
  void check(int code) const;

  const Database& database_;
  sqlite3_stmt* statement_ = nullptr;
  int parameter_ = 0;
};

/// One SQLite file.
class Database {
 public:
  enum class Access { kCreate, kWrite, kRead };  ///< kWrite: what is there already.
  /// @throws Error (kBadData) if it cannot be opened.
  Database(const std::filesystem::path& file, Access access);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  void execute(const char* sql) const;
  bool hasTable(const char* name) const;
  bool hasColumn(const char* table, const char* name) const;
  std::int64_t lastId() const { return sqlite3_last_insert_rowid(handle_); }
  sqlite3* handle() const { return handle_; }
  /// @throws Error (kBadData) with the file's name and SQLite's reason.
  [[noreturn]] void refuse(int code) const;

 private:
  int open(const std::string& name, int flags);

  std::filesystem::path file_;
  sqlite3* handle_ = nullptr;
};

/// Rolls back on every way out but commit().
class Transaction {
 public:
  explicit Transaction(const Database& database) : database_(database) {
    database_.execute("BEGIN IMMEDIATE");
  }
  ~Transaction() {
    if (!done_) sqlite3_exec(database_.handle(), "ROLLBACK", nullptr, nullptr, nullptr);
  }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit() {
    database_.execute("COMMIT");
    done_ = true;
  }

 private:
  const Database& database_;
  bool done_ = false;
};

}  // namespace servocal::session
