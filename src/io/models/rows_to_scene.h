// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

struct SceneOfRows {
  Scene scene;
  std::string rig_source;  // in words
};

// Finds rigs and frames according to the options and brings a database or model
// into canonical order. Pairs are ignored. `kind` is the word for the input in
// messages, "database" or "model".
SceneOfRows BuildSceneOfRows(const std::string& kind, DatabaseContents contents,
                             const SceneLoadingOptions& options,
                             const Context& context);

struct RigConfigurationSummary {
  size_t num_rigs = 0;
  size_t num_sensors = 0;
  size_t num_frames = 0;
  size_t num_images = 0;
  std::string rig_source;  // for messages
};

// Finds rigs and frames according to SceneLoadingOptions, ignoring those in the
// database, and replaces them in one transaction. Images get the camera of
// their sensor: equal cameras of one sensor are merged, a camera shared by two
// sensors is copied, as COLMAP's rigs require, and intrinsics of a
// configuration replace those of the camera. Features and matches do not
// change.
RigConfigurationSummary ConfigureRigs(const SceneLoadingOptions& options,
                                      FeatureDatabase* database,
                                      const Context& context);

}  // namespace mgsfm
