// SPDX-License-Identifier: BSD-3-Clause
#include "io/database/sqlite_database.h"

#include <cctype>
#include <filesystem>

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

}  // namespace

void ThrowDatabaseError(const std::string& path, const std::string& problem) {
  throw Error("database '" + path + "': " + problem);
}

SqliteStatement::SqliteStatement(sqlite3* db, const std::string& path,
                                 const std::string& sql)
    : db_(db), path_(path) {
  sqlite3_stmt* statement = nullptr;
  Check(sqlite3_prepare_v2(db, sql.c_str(), -1, &statement, nullptr));
  statement_.reset(statement);
}

void SqliteStatement::Check(int result) const {
  if (result != SQLITE_OK) {
    ThrowDatabaseError(path_, Describe(result, sqlite3_errmsg(db_)));
  }
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

bool SqliteStatement::IsNull(int column) const {
  return sqlite3_column_type(statement_.get(), column) == SQLITE_NULL;
}

int64_t SqliteStatement::Int(int column) const {
  return sqlite3_column_int64(statement_.get(), column);
}

std::string SqliteStatement::Text(int column) const {
  const unsigned char* text = sqlite3_column_text(statement_.get(), column);
  if (text == nullptr) return {};
  const int size = sqlite3_column_bytes(statement_.get(), column);
  return std::string(reinterpret_cast<const char*>(text), size);
}

BlobView SqliteStatement::Blob(int column) const {
  const void* data = sqlite3_column_blob(statement_.get(), column);
  const int size = sqlite3_column_bytes(statement_.get(), column);
  return {static_cast<const char*>(data), static_cast<size_t>(size)};
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
    : path_(path) {
  sqlite3* db = nullptr;
  const int result = sqlite3_open_v2(file.c_str(), &db, flags, nullptr);
  db_.reset(db);
  if (result != SQLITE_OK) {
    ThrowDatabaseError(path, std::string("cannot be opened: ") +
                                 sqlite3_errstr(result) +
                                 "; check the permissions of the file and its "
                                 "folder");
  }
  Execute("PRAGMA temp_store = MEMORY");
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
  const int result =
      sqlite3_exec(db_.get(), sql.c_str(), nullptr, nullptr, nullptr);
  if (result != SQLITE_OK) {
    ThrowDatabaseError(path_, Describe(result, sqlite3_errmsg(db_.get())));
  }
}

SqliteStatement SqliteDatabase::Prepare(const std::string& sql) const {
  return SqliteStatement(db_.get(), path_, sql);
}

bool SqliteDatabase::HasTable(const std::string& table) const {
  SqliteStatement statement =
      Prepare("SELECT 1 FROM sqlite_master WHERE name = ?1");
  statement.BindText(1, table);
  return statement.Step();
}

std::set<std::string> SqliteDatabase::Columns(const std::string& table) const {
  std::set<std::string> columns;
  SqliteStatement statement = Prepare("PRAGMA table_info(" + table + ")");
  while (statement.Step()) columns.insert(statement.Text(1));
  return columns;
}

}  // namespace mgsfm
