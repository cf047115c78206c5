// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// What a run knows beside the result of RunMapper.
struct RunDescription {
  std::string version;
  std::string database_path;
  std::string input_path;        // of the model that was gone on from, or ""
  std::string rig_source;        // in words: where rigs and frames come from
  std::string options_json;      // all options, as a JSON object
  std::vector<StageTime> times;  // of reading and writing
  double peak_memory_mib = 0.0;
};

// The report of a run as indented JSON: input, options, per stage its time,
// sizes, iterations and termination, what was filtered and why, per model the
// calibrated rig and how well it was determined, and the frames that are in no
// model with the reason. Angles in degrees, lengths in the unit of the model.
std::string MapperReportToJson(const Scene& scene, const ViewGraph& view_graph,
                               const MapperResult& result,
                               const RunDescription& run);

}  // namespace mgsfm
