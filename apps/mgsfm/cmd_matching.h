// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The options that all matching commands share.
struct MatchingInputOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Add matches and two-view geometries to this COLMAP database with "
      "features; pairs that have them are skipped."};
  Option<std::string> shard{
      "shard", "",
      "Match share i of n of the pairs, such as 3/8, into the database "
      "shard_path. database_path is only read, by any number of processes. "
      "database_merger joins the shards."};
  Option<std::string> shard_path{
      "shard_path", "",
      "Write the matches of one share to this database, which is created if "
      "missing. An interrupted run continues."};
  Option<std::string> output_pairs_path{
      "output_pairs_path", "",
      "Write the selected pairs to this file without matching them. Set it to "
      "select pairs once and match them with matches_importer --shard."};
  SceneLoadingOptions loading;
  PairMatchingOptions matching;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, shard, shard_path, output_pairs_path, loading,
          matching);
  }
};

struct MatchingInput {
  FeatureDatabase database;
  Scene scene;
};

// Throws Error if the database has no images.
MatchingInput OpenMatchingInput(
    const MatchingInputOptions& options, const Context& context,
    FeatureDatabase::OpenMode mode = FeatureDatabase::OpenMode::kExisting);

// Warns of fisheyes with a perspective camera model. Runs after matching,
// because verified matches reveal them.
void WarnOfFisheyes(const MatchingInput& input,
                    const PairMatchingOptions& options, const Context& context);

}  // namespace mgsfm
