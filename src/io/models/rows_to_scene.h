// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"
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

}  // namespace mgsfm
