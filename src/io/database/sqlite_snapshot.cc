// SPDX-License-Identifier: BSD-3-Clause
#include "database/sqlite_snapshot.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "base/file_reading.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Files beside a database that may hold changes to it: the write-ahead log,
// and the journal with which an interrupted transaction is undone.
constexpr const char* kSideFileSuffixes[] = {"-wal", "-journal"};

// Every database begins with a header of this form; see "The Database Header"
// in the documentation of SQLite's file format.
constexpr size_t kHeaderSize = 100;
constexpr std::string_view kMagic("SQLite format 3\0", 16);

// Zeros beyond the end of the file.
std::string ReadHeader(const std::string& path) {
  std::string header = ReadFile(path, "database '" + path + "'", kHeaderSize);
  header.resize(kHeaderSize);
  return header;
}

uint64_t BigEndian(const std::string& bytes, size_t begin, size_t size) {
  uint64_t value = 0;
  for (size_t i = begin; i < begin + size; ++i) {
    value = value << 8 | static_cast<unsigned char>(bytes[i]);
  }
  return value;
}

void CheckIsDatabase(const std::string& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) {
    ThrowDatabaseError(path, "there is no such file; check the path");
  }
  if (!fs::is_regular_file(status)) {
    ThrowDatabaseError(path, "is not a file; give the database file itself");
  }
  if (!HasDatabaseHeader(path)) {
    ThrowDatabaseError(path,
                       "is not an SQLite database; give the one that COLMAP's "
                       "feature extractor made");
  }
}

// SQLite itself notices a missing page only when it reads the page.
void CheckIsComplete(const std::string& path) {
  const std::string header = ReadHeader(path);
  const uint64_t page_size = BigEndian(header, 16, 2);
  // 65536 does not fit in two bytes; 1 stands for it.
  const uint64_t num_bytes =
      (page_size == 1 ? 65536 : page_size) * BigEndian(header, 28, 4);
  const bool is_current = BigEndian(header, 24, 4) == BigEndian(header, 92, 4);
  const uint64_t expected =
      std::max<uint64_t>(is_current ? num_bytes : 0, kHeaderSize);
  std::error_code error;
  const uint64_t size = fs::file_size(path, error);
  if (error || size >= expected) return;
  ThrowDatabaseError(path, "is truncated, it has " + std::to_string(size) +
                               " bytes instead of at least " +
                               std::to_string(expected) +
                               "; copy it again from where it was made");
}

}  // namespace

bool HasDatabaseHeader(const std::string& path) {
  return ReadHeader(path).compare(0, kMagic.size(), kMagic) == 0;
}

TemporaryFolder::TemporaryFolder() {
  std::error_code error;
  const fs::path parent = fs::temp_directory_path(error);
  path_ = (parent / "mgsfm_XXXXXX").string();
  if (error || mkdtemp(path_.data()) == nullptr) {
    throw Error("cannot make a folder for temporary files" +
                (error ? std::string() : " in '" + parent.string() + "'") +
                ": set TMPDIR to a folder that can be written");
  }
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

bool SqliteSnapshot::FileState::operator==(const FileState& other) const {
  return size == other.size && seconds == other.seconds &&
         nanoseconds == other.nanoseconds;
}

SqliteSnapshot::FileState SqliteSnapshot::StateOf(const std::string& file) {
  struct stat status;
  if (stat(file.c_str(), &status) != 0) return {};
#ifdef __APPLE__
  const timespec& changed = status.st_mtimespec;
#else
  const timespec& changed = status.st_mtim;
#endif
  return {status.st_size, changed.tv_sec, changed.tv_nsec};
}

std::vector<SqliteSnapshot::FileState> SqliteSnapshot::States() const {
  std::vector<FileState> states = {StateOf(path_)};
  for (const char* suffix : kSideFileSuffixes) {
    FileState state = StateOf(path_ + suffix);
    // An empty side file is as good as none.
    states.push_back(state.size > 0 ? state : FileState());
  }
  return states;
}

SqliteSnapshot::SqliteSnapshot(const std::string& path) : path_(path) {
  CheckIsDatabase(path);
  // SQLite looks for side files beside the file that a link leads to.
  path_ = fs::canonical(path).string();
  states_ = States();
  std::vector<std::string> side_files;
  for (const char* suffix : kSideFileSuffixes) {
    if (StateOf(path_ + suffix).size > 0) side_files.emplace_back(suffix);
  }
  if (side_files.empty()) {
    CheckIsComplete(path_);
    database_ = SqliteDatabase::OpenImmutable(path_, path);
  } else {
    OpenCopy(side_files);
  }
  int64_t num_bytes = 0;
  for (const FileState& state : states_) {
    num_bytes += std::max<int64_t>(0, state.size);
  }
  database_->LimitWork(static_cast<uint64_t>(num_bytes));
}

void SqliteSnapshot::OpenCopy(const std::vector<std::string>& side_files) {
  folder_ = std::make_unique<TemporaryFolder>();
  const std::string copy = folder_->path() + "/database.db";
  std::error_code error;
  fs::copy_file(path_, copy, error);
  for (const std::string& suffix : side_files) {
    if (!error) fs::copy_file(path_ + suffix, copy + suffix, error);
  }
  // A file that vanishes shows that another program has just written.
  if (error == std::errc::no_such_file_or_directory) ThrowChanged();
  if (error) {
    ThrowDatabaseError(path_, "cannot be copied to '" + folder_->path() +
                                  "' (" + error.message() +
                                  "): set TMPDIR to a folder with more space");
  }
  // The copy takes over the permissions, and SQLite must write to it.
  for (const auto& entry : fs::directory_iterator(folder_->path())) {
    fs::permissions(entry.path(),
                    fs::perms::owner_read | fs::perms::owner_write);
  }
  database_ = SqliteDatabase::OpenReadWrite(copy, path_);
}

void SqliteSnapshot::CheckUnchanged() const {
  const std::vector<FileState> states = States();
  if (states.size() != states_.size() || !(states == states_)) ThrowChanged();
}

void SqliteSnapshot::ThrowChanged() const {
  ThrowDatabaseError(path_,
                     "was written by another program while it was read; try "
                     "again when that has ended");
}

}  // namespace mgsfm
