// SPDX-License-Identifier: BSD-3-Clause
#include "faults/visible_files.h"

#include <sqlite3.h>

#include <algorithm>
#include <memory>

#include "files/model_files.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct Closer {
  void operator()(sqlite3* db) const { sqlite3_close(db); }
};

std::string Column(sqlite3_stmt* row, int column) {
  const void* data = sqlite3_column_blob(row, column);
  return std::string(static_cast<const char*>(data),
                     static_cast<size_t>(sqlite3_column_bytes(row, column)));
}

// The rows that each query selects; kDamaged if SQLite finds a fault.
class DatabaseRows {
 public:
  explicit DatabaseRows(const fs::path& path) {
    sqlite3* opened = nullptr;
    sqlite3_open(path.c_str(), &opened);
    db_.reset(opened);
  }
  std::string Select(const std::string& sql) const {
    std::string rows;
    sqlite3_stmt* row = nullptr;
    bool is_damaged = sqlite3_prepare_v2(db_.get(), sql.c_str(), -1, &row,
                                         nullptr) != SQLITE_OK;
    int result = SQLITE_DONE;
    while (!is_damaged && (result = sqlite3_step(row)) == SQLITE_ROW) {
      for (int i = 0; i < sqlite3_column_count(row); ++i) {
        rows += Column(row, i) + '\n';
      }
    }
    is_damaged = is_damaged || result != SQLITE_DONE;
    sqlite3_finalize(row);
    return is_damaged ? std::string(kDamaged) : rows;
  }

 private:
  std::unique_ptr<sqlite3, Closer> db_;
};

// The rows of all tables; kDamaged if SQLite finds a fault.
std::string DumpDatabase(const fs::path& path) {
  const DatabaseRows db(path);
  if (db.Select("PRAGMA integrity_check") != "ok\n") return kDamaged;
  std::istringstream tables(
      db.Select("SELECT name FROM sqlite_master WHERE type = 'table' AND name "
                "!= 'sqlite_sequence' ORDER BY name"));
  std::string dump;
  for (std::string table; std::getline(tables, table);) {
    const std::string rows = db.Select("SELECT * FROM " + table);
    if (rows == kDamaged) return rows;
    dump += table + ":\n" + rows;
  }
  return dump;
}

bool IsHidden(const fs::path& relative) {
  for (const fs::path& part : relative) {
    if (part.string().front() == '.') return true;
  }
  return false;
}

// A truncated page or JSON ends differently, or has no end.
std::string EndOf(const std::string& content) {
  return content.substr(content.size() - std::min<size_t>(content.size(), 2));
}

bool IsReport(const fs::path& name) {
  return name.filename() == kReportFileName || name.filename() == "report.html";
}

}  // namespace

std::string FeaturesByName(const fs::path& path) {
  return DatabaseRows(path).Select(
      "SELECT images.name, cameras.*, keypoints.rows, keypoints.cols, "
      "keypoints.data, descriptors.rows, descriptors.cols, descriptors.data "
      "FROM images JOIN cameras USING (camera_id) "
      "JOIN keypoints USING (image_id) JOIN descriptors USING (image_id) "
      "ORDER BY images.name");
}

Files VisibleFiles(const fs::path& folder) {
  Files files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const fs::path name = fs::relative(entry.path(), folder);
    if (IsHidden(name) || !entry.is_regular_file()) continue;
    if (name.extension() == ".db") {
      files[name] = DumpDatabase(entry.path());
    } else if (name.extension() == ".db-journal") {
      continue;
    } else {
      const std::string content = ReadTextFile(entry.path());
      files[name] = IsReport(name) ? EndOf(content) : content;
    }
  }
  return files;
}

std::string Differences(const Files& a, const Files& b) {
  std::string names;
  for (const auto& [name, content] : a) {
    const auto found = b.find(name);
    if (found == b.end() || found->second != content) names += name + " ";
  }
  for (const auto& [name, content] : b) {
    if (a.count(name) == 0) names += name + " ";
  }
  return names;
}

bool HasHiddenFiles(const fs::path& folder) {
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (IsHidden(fs::relative(entry.path(), folder))) return true;
  }
  return false;
}

}  // namespace mgsfm
