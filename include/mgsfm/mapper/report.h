// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Facts about a run that MapperResult does not contain.
struct RunDescription {
  std::string version;
  std::string database_path;
  std::string input_path;    // folder of the existing model, or ""
  std::string rig_source;    // source of rigs and frames, in words
  std::string options_json;  // all options, as a JSON object
  // Those that differ from their defaults, by their full names.
  std::string changed_options_json = "{}";
  std::string command;  // as typed; "" if unknown
  std::string commit;   // of the sources; "" if unknown
  std::string date;     // "2026-11-29 08:15 UTC"; "" if unknown
  uint64_t random_seed = 0;
  std::vector<StageTime> times;  // times of reading and writing
  double peak_memory_mib = 0.0;
};

// The report of a run as indented JSON: summary, warnings, input, options, and
// for each stage its time, sizes, iterations, termination and rejected data
// with the reason. Each model lists its calibrated rigs and how well they are
// determined. Frames that belong to no model are listed with the reason. Angles
// are in degrees, lengths in the unit of the model. docs/reference/report.md
// describes the keys.
std::string MapperReportToJson(const Scene& scene, const ViewGraph& view_graph,
                               const MapperResult& result,
                               const RunDescription& run);

// One line per registered frame: name, number of registered images, number of
// observations, and its confidence in [0, 1].
std::string FramesToCsv(const Scene& scene, const MapperModel& model);

}  // namespace mgsfm
