// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/pipeline/mapper.h"

namespace mgsfm {

// The memory that the mapper needs for an input, in MiB, from its numbers of
// keypoints and matches.
double EstimateMemoryMib(const MapperInput& input);

// Throws Error, with the number of clusters that would fit, if the estimate is
// above the limit. 0: not limited.
void CheckMemory(const MapperInput& input, int max_memory_mib);

}  // namespace mgsfm
