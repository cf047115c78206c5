// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "baselines/mapper_baselines.h"
#include "extension/model_placement.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/io/database/scene_loading.h"
#include "mgsfm/io/models/model_io.h"
#include "mgsfm/io/priors/pose_priors.h"
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
  std::string input_path = {};        // of a model to go on from; may be empty
  std::string image_list_path = {};   // of the images to take; empty: all
  BaselineOptions baseline = {};      // by default the product
};

// A database as a run takes it, and the model that it starts from.
struct MapperInput {
  LoadedScene loaded;
  std::optional<PlacedModel> start;
};

struct StartUse {
  bool takes_points = true;  // of the model, see PlaceModel
  // Its images stay where they are, so they are treated as single ones if they
  // are not rigid units.
  bool holds_poses = false;
};

// Of the database, the listed images and those of the model. Throws Error for
// bad input.
MapperInput LoadMapperInput(const MapperRun& run, StartUse use,
                            const Context& context);

// Gives the points of models the colours of the images.
void ColorModels(const Scene& scene, const std::string& image_path,
                 const Context& context, MapperResult* result);

// Throws Error unless it is empty or a folder.
void CheckImagePath(const std::string& image_path);

// Returns an ExitCode. What was at output_path is replaced when the models are
// whole. Throws Error for bad input.
int MapDatabase(const MapperRun& run, const Context& context);

}  // namespace mgsfm
