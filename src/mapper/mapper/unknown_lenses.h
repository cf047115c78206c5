// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Reconstructs pairs of a scene with priors for its lenses.
using SceneMapper = std::function<MapperResult(
    const Scene& scene, const ViewGraph& matches,
    const CalibrationPrior& lenses, const MapperOptions& options,
    const Context& context)>;

// Maps the scene. First estimates the lenses without calibration, if there are
// any, from pairs and then by maps of a part of the scene
// (lenses/lens_calibration.h).
[[nodiscard]] MapperResult MapWithLenses(const MapperInput& input,
                                         const SceneMapper& map_scene,
                                         const MapperOptions& options,
                                         const Context& context);

}  // namespace mgsfm
