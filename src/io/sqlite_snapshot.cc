// SPDX-License-Identifier: BSD-3-Clause
#include "io/sqlite_snapshot.h"

#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Files beside a database that may hold changes to it: the write-ahead log,
// and the journal with which an interrupted transaction is undone.
constexpr const char* kSideFileSuffixes[] = {"-wal", "-journal"};

void CheckIsDatabase(const std::string& path) {
  if (!fs::exists(path)) ThrowDatabaseError(path, "there is no such file");
  if (!fs::is_regular_file(path)) ThrowDatabaseError(path, "is not a file");
  constexpr std::string_view kMagic("SQLite format 3\0", 16);
  std::string head(kMagic.size(), '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file) ThrowDatabaseError(path, "cannot be read");
  if (!file.read(head.data(), static_cast<std::streamsize>(head.size())) ||
      head != kMagic) {
    ThrowDatabaseError(path, "is not an SQLite database");
  }
}

}  // namespace

TemporaryFolder::TemporaryFolder()
    : path_((fs::temp_directory_path() / "mgsfm_XXXXXX").string()) {
  if (mkdtemp(path_.data()) == nullptr) {
    throw Error("cannot make a folder in '" +
                fs::temp_directory_path().string() +
                "': set TMPDIR to a folder that can be written");
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
  return {status.st_size, status.st_mtim.tv_sec, status.st_mtim.tv_nsec};
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
    database_ = SqliteDatabase::OpenImmutable(path_, path);
  } else {
    OpenCopy(side_files);
  }
}

void SqliteSnapshot::OpenCopy(const std::vector<std::string>& side_files) {
  folder_ = std::make_unique<TemporaryFolder>();
  const std::string copy = folder_->path() + "/database.db";
  std::error_code error;
  fs::copy_file(path_, copy, error);
  for (const std::string& suffix : side_files) {
    if (!error) fs::copy_file(path_ + suffix, copy + suffix, error);
  }
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
  if (states.size() != states_.size() || !(states == states_)) {
    ThrowDatabaseError(path_,
                       "was written by another program while it was read; try "
                       "again when that has ended");
  }
}

}  // namespace mgsfm
