// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "mapper_run.h"
#include "mgsfm/base/context.h"
#include "mgsfm/fleet/view_graph_partition.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/model_tools/model_tools.h"

namespace mgsfm {

// Throws Error, with the number of clusters that would fit, if the mapper needs
// more memory for its input, by its numbers of keypoints and matches, than the
// limit. 0: not limited.
void CheckMemory(const MapperInput& input, int max_memory_mib);

// The number of observations with which joined models can be adjusted within
// the limit; nullopt if all observations fit. Throws Error if so few remain
// that they do not determine the poses. 0: no limit.
std::optional<size_t> MaxNumAdjustedObservations(
    const std::vector<SceneModel>& models, int max_memory_mib);

// Cuts the view graph of a database and writes clusters.json, and the list of
// images of each cluster as 0.txt, 1.txt, ..., into run.output_path. Returns an
// ExitCode. Throws Error for bad input.
int PartitionDatabase(const MapperRun& run, const PartitionOptions& options,
                      const Context& context);

// The number of clusters in this folder. Throws Error, naming the file, if it
// has no valid clusters.json.
size_t CountClusters(const std::string& folder);

}  // namespace mgsfm
