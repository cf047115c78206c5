// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <memory>
#include <set>
#include <string>

#include "mgsfm/base/error.h"

namespace mgsfm {

// "database 'path': problem", the form of all messages on databases.
[[noreturn]] void ThrowDatabaseError(const std::string& path,
                                     const std::string& problem);

// Bytes of a column, valid until the next step of the statement.
struct BlobView {
  const char* data = nullptr;
  size_t size = 0;
};

// A prepared statement. Parameters count from 1, columns from 0, as in SQLite.
class SqliteStatement {
 public:
  SqliteStatement(sqlite3* db, const std::string& path, const std::string& sql);

  // Advances to the next row; returns false after the last.
  bool Step();
  // Runs a statement without result rows and resets it for new parameters.
  void Run();

  bool IsNull(int column) const;
  int64_t Int(int column) const;
  std::string Text(int column) const;
  BlobView Blob(int column) const;

  void BindNull(int parameter);
  void BindInt(int parameter, int64_t value);
  void BindDouble(int parameter, double value);
  void BindText(int parameter, const std::string& value);
  // The bytes must live until Run().
  void BindBlob(int parameter, const void* data, size_t size);

 private:
  void Check(int result) const;

  struct Finalizer {
    void operator()(sqlite3_stmt* statement) const {
      sqlite3_finalize(statement);
    }
  };
  sqlite3* db_;
  std::string path_;
  std::unique_ptr<sqlite3_stmt, Finalizer> statement_;
};

// An open database file. Every failure of SQLite throws Error with `path`.
class SqliteDatabase {
 public:
  // Opens `file` without locks and without any side file: it must not change
  // while it is open. Messages name `path`.
  static SqliteDatabase OpenImmutable(const std::string& file,
                                      const std::string& path);
  // Opens `file` normally, with locks and recovery.
  static SqliteDatabase OpenReadWrite(const std::string& file,
                                      const std::string& path);
  static SqliteDatabase Create(const std::string& path);

  void Execute(const std::string& sql);
  SqliteStatement Prepare(const std::string& sql) const;
  bool HasTable(const std::string& table) const;
  std::set<std::string> Columns(const std::string& table) const;
  const std::string& path() const { return path_; }

 private:
  SqliteDatabase(const std::string& file, const std::string& path, int flags);

  struct Closer {
    void operator()(sqlite3* db) const { sqlite3_close(db); }
  };
  std::string path_;
  std::unique_ptr<sqlite3, Closer> db_;
};

}  // namespace mgsfm
