// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "database/sqlite_database.h"

namespace mgsfm {

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
// SQLite's own read-only mode does not do: for a database in write-ahead mode,
// COLMAP's, it makes `-wal` and `-shm` files, or fails where it cannot. So the
// file is opened as immutable, which ignores these files; and if one of them
// holds changes, the file and they are copied and the copy is opened normally.
class SqliteSnapshot {
 public:
  explicit SqliteSnapshot(const std::string& path);

  const SqliteDatabase& database() const { return *database_; }
  // Throws Error if a file was written since the constructor began: what was
  // read may then be a mixture of old and new.
  void CheckUnchanged() const;

 private:
  // Size and time of the database and its side files; absent files have none.
  struct FileState {
    int64_t size = -1;
    int64_t seconds = 0;
    int64_t nanoseconds = 0;
    bool operator==(const FileState& other) const;
  };
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
