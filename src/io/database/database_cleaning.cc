// SPDX-License-Identifier: BSD-3-Clause
#include "database/database_cleaning.h"

#include <filesystem>

#include "database/sqlite_database.h"

namespace mgsfm {
namespace {

// A table with its kind of rows. Each kind includes the previous ones. Tables
// that refer to others come first.
struct CleanedTable {
  const char* name;
  CleanedRows rows;
};
constexpr CleanedTable kTables[] = {
    {"matches", CleanedRows::kMatches},
    {"two_view_geometries", CleanedRows::kMatches},
    {"inlier_matches", CleanedRows::kMatches},
    {"descriptors", CleanedRows::kFeatures},
    {"keypoints", CleanedRows::kFeatures},
    {"pose_priors", CleanedRows::kImages},
    {"frame_data", CleanedRows::kImages},
    {"frames", CleanedRows::kImages},
    {"images", CleanedRows::kImages},
    {"rig_sensors", CleanedRows::kAll},
    {"rigs", CleanedRows::kAll},
    {"cameras", CleanedRows::kAll},
};

}  // namespace

void CleanDatabase(const std::string& path, CleanedRows rows) {
  if (!std::filesystem::is_regular_file(path)) {
    ThrowDatabaseError(path, "there is no such file; check the path");
  }
  SqliteDatabase database = SqliteDatabase::OpenReadWrite(path, path);
  if (!database.HasTable("images") || !database.HasTable("cameras")) {
    ThrowDatabaseError(path, "is not a COLMAP database; choose another file");
  }
  std::string sql = "BEGIN IMMEDIATE;";
  for (const CleanedTable& table : kTables) {
    // Enumerators are ordered from all rows to few.
    if (table.rows < rows || !database.HasTable(table.name)) continue;
    sql += std::string("DELETE FROM ") + table.name + ";";
  }
  database.Execute(sql + "COMMIT;");
}

}  // namespace mgsfm
