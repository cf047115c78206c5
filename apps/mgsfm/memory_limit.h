// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/model_tools/model_tools.h"
#include "mgsfm/pipeline/mapper.h"

namespace mgsfm {

// The memory that the mapper needs for an input, in MiB, from its numbers of
// keypoints and matches.
double EstimateMemoryMib(const MapperInput& input);

// Throws Error, with the number of clusters that would fit, if the estimate is
// above the limit. 0: not limited.
void CheckMemory(const MapperInput& input, int max_memory_mib);

// Whether the adjustment of joined models needs
// BundleAdjustmentOptions::saves_memory to keep the limit, from their numbers
// of keypoints and observations. Throws Error if even this is not enough. 0:
// not limited.
bool MustSaveMemory(const std::vector<SceneModel>& models, int max_memory_mib);

}  // namespace mgsfm
