// SPDX-License-Identifier: BSD-3-Clause
#include "matching_input.h"

#include <utility>

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
  // Missing matches are expected here, so no warning about them.
  Context quiet = context;
  quiet.log = nullptr;
  LoadedScene loaded = LoadScene(std::move(contents), options.loading, quiet);
  context.Info(std::to_string(loaded.scene.images.size()) + " images in " +
               std::to_string(loaded.scene.frames.size()) +
               " frames; rigs: " + loaded.rig_source);
  return {std::move(database), std::move(loaded.scene)};
}

}  // namespace mgsfm
