// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
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

// BundleAdjustmentOptions::num_neighbours_in_little_memory for the adjustment
// of joined models: the largest value with which the estimate, from their
// numbers of keypoints, observations, points, images and frames, keeps it;
// nullopt if the fastest adjustment does, too. Throws Error if no value does.
// 0: not limited.
std::optional<int> ChooseNumNeighbours(const std::vector<SceneModel>& models,
                                       int max_memory_mib);

}  // namespace mgsfm
