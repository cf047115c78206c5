// SPDX-License-Identifier: BSD-3-Clause
#include "database/sqlite_database.h"

#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <new>
#include <string_view>
#include <system_error>

#include "base/file_reading.h"
#include "base/nanoseconds.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// The path as part of a URI: '%', '?' and '#' have a meaning there.
std::string EscapeForUri(const std::string& path) {
  constexpr char kHex[] = "0123456789ABCDEF";
  std::string escaped;
  for (const char c : path) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0 || c == '/' || c == '.' || c == '-' ||
        c == '_') {
      escaped += c;
    } else {
      escaped += '%';
      escaped += kHex[byte >> 4];
      escaped += kHex[byte & 15];
    }
  }
  return escaped;
}

// SQLite's message with a remedy.
std::string Describe(int result, const std::string& message) {
  switch (result & 0xff) {  // without the details of extended codes
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return "is damaged (" + message +
             "); copy it again from where it was made";
    case SQLITE_ERROR:
      return "does not have COLMAP's tables (" + message +
             "); open it once with COLMAP 3.8 or later";
    case SQLITE_INTERRUPT:
      return "is damaged (reading it takes longer than its size explains); "
             "copy it again from where it was made";
    case SQLITE_FULL:
      return message + "; free some space or choose another path";
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return "is in use by another program; wait until that has ended";
    case SQLITE_READONLY:
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
      return "cannot be written (" + message +
             "); check the permissions of the file and its folder";
    default:
      return "cannot be used: " + message;
  }
}

void ThrowUnlessOk(int result, const std::string& path, sqlite3* db) {
  if (result == SQLITE_OK) return;
  if (result == SQLITE_NOMEM) throw std::bad_alloc();
  ThrowDatabaseError(path, Describe(result, sqlite3_errmsg(db)));
}

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

void ThrowDatabaseError(const std::string& path, const std::string& problem) {
  throw Error("database '" + path + "': " + problem);
}

SqliteStatement::SqliteStatement(sqlite3* db, const std::string& path,
                                 const std::string& sql, uint64_t max_bytes)
    : db_(db), path_(path), num_bytes_left_(max_bytes) {
  sqlite3_stmt* statement = nullptr;
  Check(sqlite3_prepare_v2(db, sql.c_str(), -1, &statement, nullptr));
  statement_.reset(statement);
}

void SqliteStatement::Check(int result) const {
  ThrowUnlessOk(result, path_, db_);
}

bool SqliteStatement::Step() {
  const int result = sqlite3_step(statement_.get());
  if (result == SQLITE_ROW) return true;
  if (result != SQLITE_DONE) Check(result);
  return false;
}

void SqliteStatement::Run() {
  Step();
  Check(sqlite3_reset(statement_.get()));
}

int64_t SqliteStatement::Int(int column) const {
  return sqlite3_column_int64(statement_.get(), column);
}

std::string SqliteStatement::Text(int column) const {
  const unsigned char* text = sqlite3_column_text(statement_.get(), column);
  if (text == nullptr) return {};
  const int size = CountBytes(column);
  return std::string(reinterpret_cast<const char*>(text), size);
}

BlobView SqliteStatement::Blob(int column) const {
  const void* data = sqlite3_column_blob(statement_.get(), column);
  const int size = CountBytes(column);
  return {static_cast<const char*>(data), static_cast<size_t>(size)};
}

int SqliteStatement::CountBytes(int column) const {
  const int size = sqlite3_column_bytes(statement_.get(), column);
  if (static_cast<uint64_t>(size) > num_bytes_left_) Check(SQLITE_INTERRUPT);
  num_bytes_left_ -= static_cast<uint64_t>(size);
  return size;
}

void SqliteStatement::BindText(int parameter, const std::string& value) {
  Check(sqlite3_bind_text64(statement_.get(), parameter, value.data(),
                            value.size(), SQLITE_TRANSIENT, SQLITE_UTF8));
}

void SqliteStatement::BindBlob(int parameter,
                               const std::optional<BlobView>& blob) {
  if (!blob) return Check(sqlite3_bind_null(statement_.get(), parameter));
  // A null pointer would be bound as NULL instead of an empty blob.
  const void* bytes = blob->size == 0 ? "" : blob->data;
  Check(sqlite3_bind_blob64(statement_.get(), parameter, bytes, blob->size,
                            SQLITE_STATIC));
}

SqliteDatabase::SqliteDatabase(const std::string& file, const std::string& path,
                               int flags)
    : path_(path), num_steps_left_(std::make_unique<int64_t>(max_steps_)) {
  sqlite3* db = nullptr;
  const int result = sqlite3_open_v2(file.c_str(), &db, flags, nullptr);
  db_.reset(db);
  if (result == SQLITE_NOMEM) throw std::bad_alloc();
  if (result != SQLITE_OK) {
    ThrowDatabaseError(path, std::string("cannot be opened: ") +
                                 sqlite3_errstr(result) +
                                 "; check the permissions of the file and its "
                                 "folder");
  }
  Harden();
}

// See https://www.sqlite.org/security.html.
void SqliteDatabase::Harden() {
  for (const auto& [option, value] :
       {std::pair(SQLITE_DBCONFIG_DEFENSIVE, 1),
        std::pair(SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0),
        std::pair(SQLITE_DBCONFIG_ENABLE_VIEW, 0),
        std::pair(SQLITE_DBCONFIG_ENABLE_TRIGGER, 0)}) {
    MGSFM_CHECK_EQ(sqlite3_db_config(db_.get(), option, value, nullptr),
                   SQLITE_OK);
  }
  for (const auto& [limit, value] :
       {std::pair(SQLITE_LIMIT_SQL_LENGTH, 100'000),
        std::pair(SQLITE_LIMIT_COLUMN, 100),
        std::pair(SQLITE_LIMIT_EXPR_DEPTH, 50),
        std::pair(SQLITE_LIMIT_ATTACHED, 0)}) {
    sqlite3_limit(db_.get(), limit, value);
  }
  Execute(
      "PRAGMA temp_store = MEMORY; PRAGMA cell_size_check = ON; "
      "PRAGMA mmap_size = 0");
}

void SqliteDatabase::LimitWork(uint64_t file_size) {
  // Values are counted again when they are decoded twice.
  max_bytes_ = 2 * file_size;
  // A row has some bytes and takes some tens of steps, sorted or not.
  constexpr int64_t kStepsPerByte = 100, kStepsPerCall = 10'000;
  max_steps_ =
      1 + static_cast<int64_t>(file_size) * kStepsPerByte / kStepsPerCall;
  *num_steps_left_ = max_steps_;
  const auto count = [](void* num_left) {
    return --*static_cast<int64_t*>(num_left) < 0 ? 1 : 0;
  };
  sqlite3_progress_handler(db_.get(), kStepsPerCall, count,
                           num_steps_left_.get());
  // A value cannot be longer than its file. The lower limit exceeds the text of
  // any statement; the upper limit is the default of SQLite.
  constexpr uint64_t kMinLength = 1'000'000, kMaxLength = 1'000'000'000;
  sqlite3_limit(
      db_.get(), SQLITE_LIMIT_LENGTH,
      static_cast<int>(std::clamp(file_size, kMinLength, kMaxLength)));
}

SqliteDatabase SqliteDatabase::OpenImmutable(const std::string& file,
                                             const std::string& path) {
  const std::string absolute = std::filesystem::absolute(file).string();
  return SqliteDatabase("file:" + EscapeForUri(absolute) + "?immutable=1", path,
                        SQLITE_OPEN_READONLY | SQLITE_OPEN_URI);
}

SqliteDatabase SqliteDatabase::OpenReadWrite(const std::string& file,
                                             const std::string& path) {
  return SqliteDatabase(file, path, SQLITE_OPEN_READWRITE);
}

SqliteDatabase SqliteDatabase::Create(const std::string& path) {
  return SqliteDatabase(path, path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
}

SqliteDatabase SqliteDatabase::OpenOrCreate(const std::string& path,
                                            bool may_create) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (path.front() == ':') {
    ThrowDatabaseError(path,
                       "is not a file to SQLite, and would be lost; choose "
                       "another name");
  }
  if (fs::is_directory(path, ignored)) {
    ThrowDatabaseError(path, "is a folder; choose a file in it");
  }
  if (!fs::exists(path, ignored)) {
    if (!may_create) {
      ThrowDatabaseError(path,
                         "there is no such file; check the path, or run the "
                         "feature extractor first");
    }
    const fs::path folder = fs::absolute(path).parent_path();
    if (!fs::is_directory(folder, ignored)) {
      ThrowDatabaseError(path, "cannot be created, as there is no folder '" +
                                   folder.string() + "'; create it first");
    }
  }
  return Create(path);
}

void SqliteDatabase::Execute(const std::string& sql) {
  ThrowUnlessOk(sqlite3_exec(db_.get(), sql.c_str(), nullptr, nullptr, nullptr),
                path_, db_.get());
}

SqliteStatement SqliteDatabase::Prepare(const std::string& sql) const {
  *num_steps_left_ = max_steps_;
  return SqliteStatement(db_.get(), path_, sql, max_bytes_);
}

bool SqliteDatabase::HasTable(const std::string& table) const {
  SqliteStatement entry = Prepare(
      "SELECT type = 'view' OR sql LIKE 'CREATE VIRTUAL%' FROM sqlite_master "
      "WHERE type IN ('table', 'view') AND name = ?1 COLLATE NOCASE",
      table);
  if (!entry.Step()) return false;
  SqliteStatement computed =
      Prepare("SELECT 1 FROM pragma_table_xinfo(?1) WHERE hidden != 0", table);
  if (entry.Int(0) != 0 || computed.Step()) {
    ThrowDatabaseError(path_, "computes the rows of '" + table +
                                  "' instead of storing them, so it is not "
                                  "COLMAP's; give one that COLMAP made");
  }
  return true;
}

std::set<std::string> SqliteDatabase::Columns(const std::string& table) const {
  std::set<std::string> columns;
  SqliteStatement statement = Prepare("PRAGMA table_info(" + table + ")");
  while (statement.Step()) columns.insert(statement.Text(1));
  return columns;
}

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

SqliteSnapshot::FileState SqliteSnapshot::StateOf(const std::string& file) {
  struct stat status;
  if (stat(file.c_str(), &status) != 0) return {-1, 0, 0};
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
    const FileState state = StateOf(path_ + suffix);
    // An empty side file counts as absent.
    states.push_back(std::get<0>(state) > 0 ? state : FileState(-1, 0, 0));
  }
  return states;
}

SqliteSnapshot::SqliteSnapshot(const std::string& path) : path_(path) {
  CheckIsDatabase(path);
  // SQLite looks for side files beside the target of a link.
  path_ = fs::canonical(path).string();
  states_ = States();
  std::vector<std::string> side_files;
  for (const char* suffix : kSideFileSuffixes) {
    if (std::get<0>(StateOf(path_ + suffix)) > 0) {
      side_files.emplace_back(suffix);
    }
  }
  if (side_files.empty()) {
    CheckIsComplete(path_);
    database_ = SqliteDatabase::OpenImmutable(path_, path);
  } else {
    OpenCopy(side_files);
  }
  int64_t num_bytes = 0;
  for (const FileState& state : states_) {
    num_bytes += std::max<int64_t>(0, std::get<0>(state));
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
  // A vanished file shows that another program has just written.
  if (error == std::errc::no_such_file_or_directory) ThrowChanged();
  if (error) {
    ThrowDatabaseError(path_, "cannot be copied to '" + folder_->path() +
                                  "' (" + error.message() +
                                  "): set TMPDIR to a folder with more space");
  }
  // The copy has the permissions of the original, but SQLite must write to it.
  for (const auto& entry : fs::directory_iterator(folder_->path())) {
    fs::permissions(entry.path(),
                    fs::perms::owner_read | fs::perms::owner_write);
  }
  database_ = SqliteDatabase::OpenReadWrite(copy, path_);
}

void SqliteSnapshot::CheckUnchanged() const {
  if (States() != states_) ThrowChanged();
}

void SqliteSnapshot::ThrowChanged() const {
  ThrowDatabaseError(path_,
                     "was written by another program while it was read; try "
                     "again when that has ended");
}

}  // namespace mgsfm
