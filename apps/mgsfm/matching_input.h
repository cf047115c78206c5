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
  std::string database_path;
  SceneLoadingOptions loading;
  PairMatchingOptions matching;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit(
        "database_path", self.database_path, Required(), "",
        "COLMAP database with features. Adds matches; pairs that have matches "
        "are skipped.");
    SceneLoadingOptions::Describe(self.loading, visit);
    PairMatchingOptions::Describe(self.matching, visit);
  }
};

struct MatchingInput {
  FeatureDatabase database;
  Scene scene;
};

// Throws Error if the database has no images.
MatchingInput OpenMatchingInput(const MatchingInputOptions& options,
                                const Context& context);

}  // namespace mgsfm
