// SPDX-License-Identifier: BSD-3-Clause
#include "matching_input.h"

#include <utility>

#include "io/models/rows_to_scene.h"
#include "matching/lens_check.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

MatchingInput OpenMatchingInput(const MatchingInputOptions& options,
                                const Context& context) {
  FeatureDatabase database(options.database_path,
                           FeatureDatabase::OpenMode::kExisting);
  DatabaseContents contents = database.ReadStructure(context);
  if (contents.images.empty()) {
    throw Error("database '" + *options.database_path +
                "' has no images; run feature_extractor first");
  }
  SceneOfRows rows = BuildSceneOfRows("database", std::move(contents),
                                      options.loading, context);
  context.Info(std::to_string(rows.scene.images.size()) + " images in " +
               std::to_string(rows.scene.frames.size()) +
               " frames; rigs: " + rows.rig_source);
  return {std::move(database), std::move(rows.scene)};
}

void WarnOfFisheyes(const MatchingInput& input,
                    const PairMatchingOptions& options,
                    const Context& context) {
  for (const FisheyeFinding& finding : FindFisheyes(
           input.database, input.scene, options.two_view_geometry, context)) {
    context.Warning(Describe(finding));
  }
}

}  // namespace mgsfm
