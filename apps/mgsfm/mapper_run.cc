// SPDX-License-Identifier: BSD-3-Clause
#include "mapper_run.h"

#include <filesystem>
#include <set>
#include <utility>

#include "command.h"
#include "io/database/image_list.h"
#include "io/files/output_file.h"
#include "io/files/staged_output.h"
#include "io/models/point_colors.h"
#include "io/rigs/image_timestamps.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/stage_time.h"
#include "mgsfm/io/rigs/rig_config.h"
#include "mgsfm/pipeline/report.h"
#include "pipeline/covariance_report.h"

namespace mgsfm {
namespace {

void CheckTimestamps(const MapperRun& run) {
  if (run.image_timestamps_path.empty() &&
      run.mapper.soft_rig.method == SoftRig::kTimeOffset) {
    throw Error(
        "--SoftRig.method time_offset needs the times of images; "
        "set --image_timestamps_path");
  }
}

void LogInput(const LoadedScene& loaded, const Context& context) {
  context.Info("read " + std::to_string(loaded.scene.images.size()) +
               " images in " + std::to_string(loaded.scene.frames.size()) +
               " frames, " + std::to_string(loaded.view_graph.pairs.size()) +
               " pairs; rigs: " + loaded.rig_source);
}

// The names of the images to use; empty: all.
std::set<std::string> ListImages(const std::string& list_path,
                                 const std::optional<Model>& model) {
  if (list_path.empty()) return {};
  const std::vector<std::string> listed = ReadImageList(list_path);
  std::set<std::string> names(listed.begin(), listed.end());
  if (names.empty()) {
    throw Error("'" + list_path + "' (--image_list_path) lists no image");
  }
  if (!model) return names;
  for (const ModelImage& image : model->poses.images) names.insert(image.name);
  return names;
}

void IgnoreRigs(LoadedScene* loaded) {
  loaded->scene = SeparateImages(std::move(loaded->scene));
  loaded->rig_source = "ignored, each image is a rig of its own";
}

void LogModel(const Scene& scene, const MapperModel& model, size_t model_idx,
              const Context& context) {
  size_t num_images = 0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    num_images +=
        model.reconstruction.IsRegistered(scene, static_cast<int>(i)) ? 1 : 0;
  }
  context.Info("model " + std::to_string(model_idx) + ": " +
               std::to_string(num_images) + " of " +
               std::to_string(scene.images.size()) + " images, " +
               std::to_string(model.reconstruction.points.size()) + " points");
}

// A soft rig has one pose per image. Then each image is written as a frame of
// its own, so that the tables agree.
void WriteModelFiles(const std::filesystem::path& folder, const Scene& scene,
                     const MapperModel& model, ModelFormat format,
                     const Context& context) {
  if (model.soft_rig_images && model.soft_rig_images->summary.is_usable) {
    WriteModel(folder, SeparateImages(scene),
               SeparateImages(model.reconstruction,
                              model.soft_rig_images->cam_from_world),
               format, context);
  } else {
    WriteModel(folder, scene, model.reconstruction, format, context);
  }
}

void WriteModels(const LoadedScene& loaded, const MapperResult& result,
                 const PositionPriors& priors, ModelFormat format,
                 const std::filesystem::path& output_path,
                 const Context& context) {
  for (size_t i = 0; i < result.models.size(); ++i) {
    const std::filesystem::path folder = output_path / std::to_string(i);
    const Reconstruction& model = result.models[i].reconstruction;
    std::filesystem::create_directory(folder);
    WriteModelFiles(folder, loaded.scene, result.models[i], format, context);
    WriteRigConfig((folder / "rig_config.json").string(), loaded.scene, model);
    const auto& registration = result.models[i].position_priors;
    if (registration && registration->is_registered && priors.origin_wgs84) {
      WriteGeoOrigin((folder / "geo_origin.json").string(),
                     *priors.origin_wgs84);
    }
    const auto& covariances = result.models[i].covariances;
    if (covariances && covariances->is_usable) {
      WriteFile(folder / "covariances.csv",
                CovariancesToCsv(loaded.scene, *covariances));
    }
    LogModel(loaded.scene, result.models[i], i, context);
  }
}

// A model that was extended without registration keeps its origin.
void KeepGeoOrigin(const std::filesystem::path& input_path,
                   const MapperResult& result,
                   const std::filesystem::path& output_path) {
  const std::filesystem::path origin = input_path / "geo_origin.json";
  if (input_path.empty() || !std::filesystem::is_regular_file(origin)) return;
  for (size_t i = 0; i < result.models.size(); ++i) {
    const auto& priors = result.models[i].position_priors;
    if (priors && priors->is_registered) continue;
    std::filesystem::copy_file(
        origin, output_path / std::to_string(i) / "geo_origin.json");
  }
}

}  // namespace

void CheckImagePath(const std::string& image_path) {
  if (!image_path.empty() && !std::filesystem::is_directory(image_path)) {
    throw Error("--image_path '" + image_path + "' is not a folder");
  }
}

void ColorModels(const Scene& scene, const std::string& image_path,
                 const Context& context, MapperResult* result) {
  if (image_path.empty()) return;
  for (MapperModel& model : result->models) {
    const std::vector<std::string> missing =
        ColorPoints(scene, image_path, context, &model.reconstruction);
    if (missing.empty()) continue;
    context.Warning(std::to_string(missing.size()) +
                    " images could not be read for colours; the first is " +
                    missing.front());
  }
}

void LogMissingColors(const std::string& image_path, const Context& context) {
  if (!image_path.empty()) return;
  context.Info(
      "all points are black, as no image folder was given; pass --image_path "
      "to colour them");
}

MapperInput LoadMapperInput(const MapperRun& run, StartUse use,
                            const Context& context) {
  std::optional<Model> model;
  if (!run.input_path.empty()) model = ReadModel(run.input_path);
  DatabaseContents contents = ReadDatabase(run.database_path, context);
  const auto names = ListImages(run.image_list_path, model);
  if (!names.empty()) {
    KeepListedImages(names, run.image_list_path, &contents);
  }
  MapperInput input;
  input.loaded = LoadScene(std::move(contents), run.loading, context);
  if (run.mapper.method == MapperMethod::kSingle) IgnoreRigs(&input.loaded);
  if (!run.image_timestamps_path.empty()) {
    ReadImageTimestamps(run.image_timestamps_path, &input.loaded.scene);
  }
  if (!model) return input;
  const auto place = [&] {
    input.start = PlaceModel(*model, run.input_path, run.database_path,
                             use.takes_points, &input.loaded.scene);
  };
  place();
  if (use.holds_poses && !input.start->is_rigid) {
    context.Info("the images of the model do not move as rigid units");
    IgnoreRigs(&input.loaded);
    place();
  }
  return input;
}

int MapDatabase(const MapperRun& run, const Context& context) {
  CheckImagePath(run.image_path);
  CheckTimestamps(run);
  ResolveMethod(run.mapper);  // before anything is read
  context.Debug("reading started");
  StagedOutput output(run.output_path);
  RunDescription description;
  description.version = MGSFM_VERSION;
  description.database_path = run.database_path;
  description.input_path = run.input_path;
  description.options_json = run.options_json;

  const StageTimer reading;
  const MapperInput input = LoadMapperInput(run, StartUse(), context);
  const LoadedScene& loaded = input.loaded;
  CheckFormat(loaded.scene, run.output_format);
  description.rig_source = loaded.rig_source;
  description.times.push_back(reading.Stop("reading"));
  const PositionPriors priors =
      ReadPositionPriors(loaded.scene, run.database_path, run.priors);
  const GravityPriors gravity =
      ReadGravity(loaded.scene, run.database_path, run.priors);
  LogInput(loaded, context);

  MapperResult result =
      RunMapper(loaded.scene, loaded.view_graph, run.mapper, context, priors,
                gravity, input.start ? &input.start->reconstruction : nullptr);
  context.Debug("writing started");
  const StageTimer writing;
  ColorModels(loaded.scene, run.image_path, context, &result);
  WriteModels(loaded, result, priors, run.output_format, output.StagingDir(),
              context);
  KeepGeoOrigin(run.input_path, result, output.StagingDir());
  description.times.push_back(writing.Stop("writing"));
  description.peak_memory_mib = PeakMemoryMib();
  WriteFile(
      output.StagingDir() / "report.json",
      MapperReportToJson(loaded.scene, loaded.view_graph, result, description));
  context.CheckInterrupted();
  output.Commit();
  if (result.models.empty()) {
    context.log(
        LogLevel::kError,
        "no model could be reconstructed; see " +
            (std::filesystem::path(run.output_path) / "report.json").string());
    return kExitNotSolvable;
  }
  LogMissingColors(run.image_path, context);
  return kExitSuccess;
}

}  // namespace mgsfm
