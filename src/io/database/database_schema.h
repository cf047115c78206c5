// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/database/sqlite_database.h"

namespace mgsfm {

// Which tables and columns of COLMAP a database gets.
enum class TableLayout {
  k38,        // user_version 3800
  k312,       // 3900
  k38And312,  // 3900: what a file of 3.8 is after 3.12 has opened it
};

// Makes the tables that are not there yet, and in a new database sets its
// user_version.
void CreateTables(TableLayout layout, SqliteDatabase* database);

}  // namespace mgsfm
