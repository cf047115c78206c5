// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

namespace mgsfm {

// "database 'path': problem", the form of all messages on databases.
[[noreturn]] void ThrowDatabaseError(const std::string& path,
                                     const std::string& problem);

// Bytes of a column, valid until the next step of the statement, or of a
// parameter, valid until it runs.
struct BlobView {
  const char* data = nullptr;
  size_t size = 0;
};

template <class T>
BlobView BlobOf(const T* values, size_t size) {
  return {reinterpret_cast<const char*>(values), size * sizeof(T)};
}
template <class T>
BlobView BlobOf(const std::vector<T>& values) {
  return BlobOf(values.data(), values.size());
}

// A prepared statement. Parameters count from 1, columns from 0, as in SQLite.
class SqliteStatement {
 public:
  // Throws Error if the values read have more than `max_bytes` in total.
  SqliteStatement(sqlite3* db, const std::string& path, const std::string& sql,
                  uint64_t max_bytes);

  // Advances to the next row; returns false after the last.
  bool Step();
  // Runs a statement without result rows and resets it for new parameters,
  // after binding these values.
  void Run();
  template <class First, class... Others>
  void Run(const First& first, const Others&... others) {
    Bind(first, others...);
    Run();
  }

  // Binds the parameters 1, 2, ...: integers, enumerators, ids, floating-point
  // numbers, texts and blobs; nullopt is NULL.
  template <class... Values>
  void Bind(const Values&... values) {
    int parameter = 0;
    (BindOne(++parameter, values), ...);
  }

  int64_t Int(int column) const;
  std::string Text(int column) const;
  BlobView Blob(int column) const;
  // The file of the database.
  const std::string& path() const { return path_; }

 private:
  template <class Value>
  void BindOne(int parameter, const Value& value) {
    sqlite3_stmt* const row = statement_.get();
    if constexpr (std::is_integral_v<Value> || std::is_enum_v<Value>) {
      Check(sqlite3_bind_int64(row, parameter, static_cast<int64_t>(value)));
    } else if constexpr (std::is_floating_point_v<Value>) {
      Check(sqlite3_bind_double(row, parameter, value));
    } else if constexpr (std::is_convertible_v<Value, std::string>) {
      BindText(parameter, value);
    } else if constexpr (std::is_convertible_v<Value,
                                               std::optional<BlobView>>) {
      BindBlob(parameter, value);
    } else {
      static_assert(std::is_integral_v<std::decay_t<decltype(value.value())>>);
      BindOne(parameter, value.value());
    }
  }
  void BindText(int parameter, const std::string& value);
  void BindBlob(int parameter, const std::optional<BlobView>& blob);
  void Check(int result) const;
  int CountBytes(int column) const;

  struct Finalizer {
    void operator()(sqlite3_stmt* statement) const {
      sqlite3_finalize(statement);
    }
  };
  sqlite3* db_;
  std::string path_;
  std::unique_ptr<sqlite3_stmt, Finalizer> statement_;
  mutable uint64_t num_bytes_left_;
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
  // Opens a file for reading and writing. Throws Error, naming what is wrong
  // with the path, if it cannot be one, and if there is no file unless
  // `may_create`.
  static SqliteDatabase OpenOrCreate(const std::string& path, bool may_create);

  // From now on, a statement throws Error if it does more work or reads more
  // bytes than an intact file of this size can cause. Otherwise, cyclic page
  // trees and computed values could take unlimited time and memory.
  void LimitWork(uint64_t file_size);

  void Execute(const std::string& sql);
  SqliteStatement Prepare(const std::string& sql) const;
  template <class... Values>
  SqliteStatement Prepare(const std::string& sql,
                          const Values&... values) const {
    SqliteStatement statement = Prepare(sql);
    statement.Bind(values...);
    return statement;
  }
  // Throws Error if the name is that of a view or of a table whose rows are
  // computed: COLMAP has no such tables, and reading them would run foreign
  // code.
  bool HasTable(const std::string& table) const;
  std::set<std::string> Columns(const std::string& table) const;
  const std::string& path() const { return path_; }

 private:
  SqliteDatabase(const std::string& file, const std::string& path, int flags);

  void Harden();

  struct Closer {
    void operator()(sqlite3* db) const { sqlite3_close(db); }
  };
  std::string path_;
  uint64_t max_bytes_ = std::numeric_limits<uint64_t>::max();
  int64_t max_steps_ = std::numeric_limits<int64_t>::max();
  // Steps that the current statement may still take; SQLite calls back with
  // this address.
  std::unique_ptr<int64_t> num_steps_left_;
  std::unique_ptr<sqlite3, Closer> db_;
};

// Whether a file begins like a database.
bool HasDatabaseHeader(const std::string& path);

// A folder with a random name in the folder for temporary files, readable by
// this user only, that is removed with all its files at the end of its scope.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

// A database file, open for reading in such a way that neither it nor the
// files beside it change.
//
// SQLite's read-only mode does not suffice: for a database in write-ahead mode,
// as COLMAP uses, it creates `-wal` and `-shm` files or fails. The file is
// therefore opened as immutable, which ignores these files. If one of them
// holds changes, the file and these files are copied, and the copy is opened
// normally.
class SqliteSnapshot {
 public:
  explicit SqliteSnapshot(const std::string& path);

  const SqliteDatabase& database() const { return *database_; }
  // Throws Error if a file was written since the constructor began: the data
  // may then be a mixture of old and new.
  void CheckUnchanged() const;

 private:
  // Size and time (s, ns) of the database and its side files; absent files have
  // the size -1.
  using FileState = std::tuple<int64_t, int64_t, int64_t>;
  static FileState StateOf(const std::string& file);
  std::vector<FileState> States() const;
  [[noreturn]] void ThrowChanged() const;
  void OpenCopy(const std::vector<std::string>& side_files);

  std::string path_;
  std::vector<FileState> states_;
  std::unique_ptr<TemporaryFolder> folder_;  // outlives database_
  std::optional<SqliteDatabase> database_;
};

}  // namespace mgsfm
