// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/bundle/block_adjustment.h"
#include "mgsfm/model_tools/model_tools.h"

namespace mgsfm {

// Whether bundle adjustment of the model must be done by blocks to stay within
// the limit (MiB; 0: none). Throws Error if that does not suffice. The estimate
// is an upper bound of what was measured (docs/results/submaps.md).
bool NeedsBlocks(const SceneModel& model, const FrameBlocks& blocks,
                 int max_memory_mib);

}  // namespace mgsfm
