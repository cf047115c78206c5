// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "database/sqlite_database.h"

namespace mgsfm {

// The COLMAP version whose tables and columns a database gets.
enum class TableLayout {
  k38,        // user_version 3800
  k312,       // 3900
  k38And312,  // 3900: what a file of 3.8 is after 3.12 has opened it
};

// Creates missing tables, and sets the user_version of a new database.
void CreateTables(TableLayout layout, SqliteDatabase* database);

}  // namespace mgsfm
