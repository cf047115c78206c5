// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Tracks of the matches of the pairs in use that the model does not contradict.
// Valid as long as scene, view graph, options and context.
CandidateSource MakeCandidateSource(const Scene& scene,
                                    const ViewGraph& view_graph,
                                    Mask pair_is_used,
                                    const MapperOptions& options,
                                    const Context& context);

}  // namespace mgsfm
