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

// The memory that the mapper needs for an input, in MiB, from its numbers of
// keypoints and matches.
double EstimateMemoryMib(const MapperInput& input);

// Throws Error, with the number of clusters that would fit, if the estimate is
// above the limit. 0: not limited.
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

// A cluster in this folder.
struct ClusterFile {
  std::string image_list;  // the name of the file
  int num_frames = 0;
};

// Throws Error, naming the file, if it is not a clusters.json.
std::vector<ClusterFile> ReadClusters(const std::string& folder);

}  // namespace mgsfm
