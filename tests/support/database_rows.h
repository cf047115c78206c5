// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <string>
#include <vector>

namespace mgsfm {

// All rows of all tables of a database, in the order of their keys, by SQLite
// alone: one line each, with the values as SQL literals.
inline std::vector<std::string> RowsOf(const std::string& path) {
  sqlite3* db = nullptr;
  EXPECT_EQ(sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READONLY, nullptr),
            SQLITE_OK)
      << path;
  const auto query = [&](const std::string& sql) {
    std::vector<std::string> values;
    sqlite3_stmt* row = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(db, sql.c_str(), -1, &row, nullptr), SQLITE_OK)
        << path << ": " << sql;
    while (sqlite3_step(row) == SQLITE_ROW) {
      values.emplace_back(
          reinterpret_cast<const char*>(sqlite3_column_text(row, 0)));
    }
    sqlite3_finalize(row);
    return values;
  };
  std::vector<std::string> rows;
  for (const std::string& table : query(
           "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY 1")) {
    std::string line;
    for (const std::string& column :
         query("SELECT name FROM pragma_table_info('" + table + "')")) {
      line += (line.empty() ? "quote(" : " || ',' || quote(") + column + ")";
    }
    for (const std::string& row :
         query("SELECT " + line + " FROM " + table + " ORDER BY rowid")) {
      rows.push_back(table + ": " + row);
    }
  }
  sqlite3_close(db);
  return rows;
}

// The lines that only one of two databases has.
inline void ExpectEqualRows(const std::string& path, const std::string& other) {
  const std::vector<std::string> rows = RowsOf(path), others = RowsOf(other);
  ASSERT_EQ(rows.size(), others.size()) << path << ' ' << other;
  for (size_t i = 0; i < rows.size(); ++i) {
    ASSERT_TRUE(rows[i] == others[i])
        << path << ": " << rows[i].substr(0, 200) << '\n'
        << other << ": " << others[i].substr(0, 200);
  }
}

}  // namespace mgsfm
