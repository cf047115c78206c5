// SPDX-License-Identifier: BSD-3-Clause
#include "database/sqlite_database.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <new>
#include <utility>

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

void SqliteStatement::BindNull(int parameter) {
  Check(sqlite3_bind_null(statement_.get(), parameter));
}

void SqliteStatement::BindInt(int parameter, int64_t value) {
  Check(sqlite3_bind_int64(statement_.get(), parameter, value));
}

void SqliteStatement::BindDouble(int parameter, double value) {
  Check(sqlite3_bind_double(statement_.get(), parameter, value));
}

void SqliteStatement::BindText(int parameter, const std::string& value) {
  Check(sqlite3_bind_text64(statement_.get(), parameter, value.data(),
                            value.size(), SQLITE_TRANSIENT, SQLITE_UTF8));
}

void SqliteStatement::BindBlob(int parameter, const void* data, size_t size) {
  // A null pointer would be bound as NULL instead of an empty blob.
  const void* bytes = size == 0 ? "" : data;
  Check(sqlite3_bind_blob64(statement_.get(), parameter, bytes, size,
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
  // A value cannot be longer than its file. The lower bound exceeds the text of
  // any statement; the upper one is the default of SQLite.
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
      "WHERE type IN ('table', 'view') AND name = ?1 COLLATE NOCASE");
  entry.BindText(1, table);
  if (!entry.Step()) return false;
  SqliteStatement computed =
      Prepare("SELECT 1 FROM pragma_table_xinfo(?1) WHERE hidden != 0");
  computed.BindText(1, table);
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

}  // namespace mgsfm
