// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/io/database/feature_database.h"
#include "mgsfm/io/models/scene_loading.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The options that all matching commands share.
struct MatchingInputOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "COLMAP database with features. Adds matches and two-view geometries; "
      "pairs that have them are skipped."};
  SceneLoadingOptions loading;
  PairMatchingOptions matching;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, loading, matching);
  }
};

struct MatchingInput {
  FeatureDatabase database;
  Scene scene;
};

// Throws Error if the database has no images.
MatchingInput OpenMatchingInput(const MatchingInputOptions& options,
                                const Context& context);

// To be called after matching: warns of fisheyes whose model is perspective.
void WarnOfFisheyes(const MatchingInput& input,
                    const PairMatchingOptions& options, const Context& context);

}  // namespace mgsfm
