// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/mapper/mapper.h"

namespace mgsfm {

// A run of the mapper on a drive of few frames.
struct MapperRun {
  std::string name;
  MapperInput input;
  MapperOptions options;
  bool only_triangulates = false;  // the points of an existing model
};

// Together they need all stages.
std::vector<MapperRun> MapperRuns();

MapperResult Map(const MapperRun& run, int num_threads);

// Maps, and describes the result completely: tables of frames and covariances,
// the summary, and the bytes of models and summaries of stages.
std::string ResultOf(const MapperRun& run, int num_threads);

}  // namespace mgsfm
