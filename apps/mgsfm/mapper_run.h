// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "baselines/mapper_baselines.h"
#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/mapper/report.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/priors/pose_priors.h"

namespace mgsfm {

class LiveView;

// A mapper run from a database to models on disk, shared by commands.
struct MapperRun {
  std::string database_path;
  std::string output_path;
  std::string image_path;  // for the colors of points; may be empty
  ModelFormat output_format = ModelFormat::kBinary;
  SceneLoadingOptions loading;
  PosePriorOptions priors;
  MapperOptions mapper;
  std::string options_json;          // of the command, for the report
  std::string default_options_json;  // the same without any argument
  std::string input_path = {};       // model to extend; may be empty
  std::string image_list_path = {};  // images to use; empty: all
  BaselineOptions baseline = {};     // by default the mapper itself
  RigSplitOptions rig_split = {};
  bool write_report = false;                // a page per model
  LiveView* live = nullptr;                 // shows the run; may be null
  int max_memory_mib = 0;                   // 0: not limited
  std::string fixed_region_mask_path = {};  // folder; may be empty
};

// The input of the mapper, and facts about it for the report.
struct LoadedInput {
  MapperInput mapper;
  std::string rig_source;
};

struct StartUse {
  bool takes_points = true;  // of the model, see PlaceModel
  // Whether poses are fixed: images that do not move as rigid units then become
  // single.
  bool holds_poses = false;
};

// Loads the images of the database that are listed or belong to the existing
// model, and that model. Priors are not loaded. Throws Error for bad input.
LoadedInput LoadMapperInput(const MapperRun& run, StartUse use,
                            const Context& context);

// The index in the database of each image of a model. Throws Error if the
// database lacks one.
std::vector<size_t> FindImages(const Scene& model, const Scene& database,
                               const std::string& database_path);

// Keeps the priors of the images with these indices, if there are any.
template <class Prior>
void SelectImages(const std::vector<size_t>& idxs, std::vector<Prior>* priors) {
  const std::vector<Prior> of_all = std::exchange(*priors, {});
  if (of_all.empty()) return;
  for (const size_t i : idxs) priors->push_back(of_all[i]);
}

// Throws Error unless one antenna, which is to be estimated, has all positions:
// without positions, and with those of several cameras of an unknown body.
void CheckAntenna(const Scene& scene, const PositionPriors& positions,
                  const PosePriorOptions& options);

// Reads the priors of the images of the scene, which may be a part of those of
// the database, in any order. Files may name any image of the database, and
// positions have the origin of all of them, so that all parts get models in one
// world. If the files of times or rigs lack other images, the images of the
// scene stand alone, and the log says so.
void ReadPriors(const MapperRun& run, const Context& context,
                MapperInput* input);

// Writes the model, rig_config.json, geo_origin.json, covariances.csv and
// frames.csv, as far as there are any, into a new folder.
void WriteMapperModel(const std::filesystem::path& folder,
                      const MapperInput& input, const MapperModel& model,
                      ModelFormat format, const Context& context);

// A model, and what its page shows.
struct ModelPage {
  std::filesystem::path folder;  // of the model, for report.html
  std::string image_path;        // may be empty
  const MapperInput& input;
  const MapperModel& model;
  size_t model_idx = 0;  // in the report
  std::string report_json;
};

// Returns the page that it writes. Logs a warning and returns "" instead of
// failing, also if it is interrupted: the model is complete.
std::string WriteReportPage(const ModelPage& shown, const Context& context);

// The folder of images as a page in another folder reaches it; "" for none.
std::string PageUrl(const std::string& image_path,
                    const std::filesystem::path& page_folder);

// The description of a run and its input in the report.
RunDescription DescribeInput(const MapperRun& run, const Context& context);

// Colors the points of models, unless `image_path` is empty.
void ColorModels(const Scene& scene, const std::string& image_path,
                 const Context& context, MapperResult* result);

// Logs how to color the points if `image_path` is empty.
void LogMissingColors(const std::string& image_path, const Context& context);

// Throws Error unless it is empty or a folder.
void CheckImagePath(const std::string& image_path);

// Returns an ExitCode. Models at output_path are replaced when the new ones are
// complete. Throws Error for bad input.
int MapDatabase(const MapperRun& run, const Context& context);

}  // namespace mgsfm
