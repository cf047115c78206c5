// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/io/model_io.h"
#include "mgsfm/io/pose_priors.h"
#include "mgsfm/io/scene_loading.h"
#include "mgsfm/pipeline/mapper.h"

namespace mgsfm {

// From a database to models on disk, as commands share it.
struct MapperRun {
  std::string database_path;
  std::string output_path;
  std::string image_path;  // for the colours of points; may be empty
  ModelFormat output_format = ModelFormat::kBinary;
  SceneLoadingOptions loading;
  PosePriorOptions priors;
  MapperOptions mapper;
  std::string options_json;           // of the command, for the report
  std::string image_timestamps_path;  // may be empty
};

// Returns an ExitCode. What was at output_path is replaced when the models are
// whole. Throws Error for bad input.
int MapDatabase(const MapperRun& run, const Context& context);

}  // namespace mgsfm
