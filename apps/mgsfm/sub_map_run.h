// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "fleet/sub_maps.h"
#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "tool_model.h"

namespace mgsfm {

// Joins the models of clusters, which `mapper --partition` made.
struct SubMapRun {
  std::string input_path;     // a folder of models for each cluster
  std::string cluster_path;   // clusters.json; may be empty
  std::string database_path;  // for matches across clusters; may be empty
  std::string output_path;
  bool adjusts = true;
  int max_memory_mib = 0;  // of the adjustment; 0: not limited
  ModelFormat output_format = ModelFormat::kBinary;
  ToolRigOptions rigs;
  JoinOptions join;
  BundleAdjustmentOptions bundle_adjustment;
};

// Returns an ExitCode. Writes the joined models as folders 0, 1, ... and
// report.json. Clusters without a model are reported. Throws Error for bad
// input.
int JoinClusters(const SubMapRun& run, const Context& context);

}  // namespace mgsfm
