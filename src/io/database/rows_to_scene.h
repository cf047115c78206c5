// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/io/database/database.h"
#include "mgsfm/io/database/scene_loading.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

struct SceneOfRows {
  Scene scene;
  std::string rig_source;  // in words
};

// What databases and models have in common: finds rigs and frames as the
// options say and puts all in canonical order. Pairs have no part in it. `kind`
// is what messages call the input, "database" or "model".
SceneOfRows BuildSceneOfRows(const std::string& kind, DatabaseContents contents,
                             const SceneLoadingOptions& options,
                             const Context& context);

}  // namespace mgsfm
