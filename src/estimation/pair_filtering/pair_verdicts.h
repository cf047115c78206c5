// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Groups rejected pairs whose first frames, and whose second frames, are at
// most three apart in the order of the scene. Largest group first.
std::vector<RejectedGroup> GroupRejectedPairs(const FramePairIndex& index,
                                              const Mask& pair_is_rejected);

}  // namespace mgsfm
