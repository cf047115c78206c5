// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Makes the source of candidate tracks for bundle adjustment: tracks of the
// matches of used pairs that agree with a model. `matches` are those of the
// input, of which the view graph has a part. The source refers to all arguments
// but the mask, which must outlive it.
CandidateSource MakeCandidateSource(const Scene& scene,
                                    const ViewGraph& view_graph,
                                    const ViewGraph& matches, Mask pair_is_used,
                                    const MapperOptions& options,
                                    const Context& context);

}  // namespace mgsfm
