// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"

namespace mgsfm {

struct MergeInput {
  std::string path;
  std::string prefix = {};   // of its image names in the result
  std::string vehicle = {};  // inputs of one vehicle share cameras and rigs
};

struct DatabaseMergeSummary {
  size_t num_images = 0;
  size_t num_pairs = 0;  // with a two-view geometry
  size_t num_rigs = 0;
};

// Writes a new database with all rows of the inputs: cameras, images, features,
// matches, two-view geometries, rigs, frames and position priors. The result
// depends only on the set of inputs, not on their order or on duplicates.
//
// Databases and shards with features: ids are renumbered as by
// feature_extractor: images by name, everything else by its first image
// (merged_structure.h). Images of the same name are one; their rows must be
// equal.
//
// Shards with matches need exactly one other input: the database from which
// they were matched, whose ids do not change.
//
// Rows are copied one by one: memory grows with the number of images, not with
// features and matches. The inputs are only read.
//
// Throws Error, naming the image or pair, if inputs contradict each other; if a
// shard is unfinished, of another run or missing; if the output exists; and for
// damaged rows. There is then no output.
DatabaseMergeSummary MergeDatabases(const std::vector<MergeInput>& inputs,
                                    const std::string& merged_path,
                                    const Context& context);

}  // namespace mgsfm
