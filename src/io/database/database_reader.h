// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "database/sqlite_database.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"

namespace mgsfm {

// Reads everything but keypoints and pairs from an open database, which may
// have no image.
DatabaseContents ReadStructure(const SqliteDatabase& database,
                               const Context& context);

}  // namespace mgsfm
