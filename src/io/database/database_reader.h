// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"

namespace mgsfm {

class SqliteDatabase;

// A list of images (option image_list_path): one name per line; empty lines are
// skipped. Throws Error if it cannot be read.
[[nodiscard]] std::vector<std::string> ReadImageList(const std::string& path);

// Removes all other images, with their pairs and their entries in frames.
// Throws Error, naming `list_path`, if a name is not in the database or the
// list is empty.
void KeepListedImages(const std::set<std::string>& names,
                      const std::string& list_path, DatabaseContents* contents);

// Reads everything but keypoints and pairs from an open database, which may
// have no image.
DatabaseContents ReadStructure(const SqliteDatabase& database,
                               const Context& context);

}  // namespace mgsfm
