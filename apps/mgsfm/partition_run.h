// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mapper_run.h"
#include "mgsfm/base/context.h"
#include "mgsfm/fleet/view_graph_partition.h"

namespace mgsfm {

// Cuts the view graph of a database and writes clusters.json, and the list of
// images of each cluster as 0.txt, 1.txt, ..., into run.output_path. Returns an
// ExitCode. Throws Error for bad input.
int PartitionDatabase(const MapperRun& run, const PartitionOptions& options,
                      const Context& context);

// A cluster of such a folder.
struct ClusterFile {
  std::string image_list;  // the name of the file
  int num_frames = 0;
};

// Throws Error, naming the file, if it is not a clusters.json.
std::vector<ClusterFile> ReadClusters(const std::string& folder);

}  // namespace mgsfm
