// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"

namespace mgsfm {

struct DatabaseMergeSummary {
  size_t num_images = 0;
  size_t num_pairs = 0;  // with a two-view geometry
  size_t num_rigs = 0;
};

// Writes a new database with all rows of two: cameras, images, features,
// matches, two-view geometries, rigs, frames and position priors. Ids are
// numbered anew, those of the first database first. Rows are copied one by one,
// so memory does not grow with features and matches. The inputs are only read.
//
// Throws Error, naming the image, if both have an image of the same name; if
// the output exists; and for damaged rows. Then there is no output.
DatabaseMergeSummary MergeDatabases(const std::string& path1,
                                    const std::string& path2,
                                    const std::string& merged_path,
                                    const Context& context);

}  // namespace mgsfm
