// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/mapper/mapper.h"
#include "mgsfm/model_tools/model_tools.h"

namespace mgsfm {

// The memory that the mapper needs for an input, in MiB, from its numbers of
// keypoints and matches.
double EstimateMemoryMib(const MapperInput& input);

// Throws Error, with the number of clusters that would fit, if the estimate is
// above the limit. 0: not limited.
void CheckMemory(const MapperInput& input, int max_memory_mib);

// The number of observations by which joined models can be adjusted within the
// limit; nullopt if the estimate for all of them is below it. Throws Error if
// so few remain that they do not determine the poses. 0: not limited.
std::optional<size_t> MaxNumAdjustedObservations(
    const std::vector<SceneModel>& models, int max_memory_mib);

}  // namespace mgsfm
