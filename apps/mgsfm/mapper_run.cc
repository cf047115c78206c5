// SPDX-License-Identifier: BSD-3-Clause
#include "mapper_run.h"

#include <filesystem>
#include <utility>

#include "command.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/stage_time.h"
#include "mgsfm/io/output_file.h"
#include "mgsfm/io/point_colors.h"
#include "mgsfm/io/rig_config.h"
#include "mgsfm/io/staged_output.h"
#include "mgsfm/pipeline/covariance_report.h"
#include "mgsfm/pipeline/report.h"

namespace mgsfm {
namespace {

void CheckPaths(const MapperRun& run) {
  if (!run.image_path.empty() &&
      !std::filesystem::is_directory(run.image_path)) {
    throw Error("--image_path '" + run.image_path + "' is no folder");
  }
}

void LogInput(const LoadedScene& loaded, const Context& context) {
  context.Info("read " + std::to_string(loaded.scene.images.size()) +
               " images in " + std::to_string(loaded.scene.frames.size()) +
               " frames, " + std::to_string(loaded.view_graph.pairs.size()) +
               " pairs; rigs: " + loaded.rig_source);
}

void Color(const Scene& scene, const std::string& image_path,
           const Context& context, MapperResult* result) {
  for (MapperModel& model : result->models) {
    const std::vector<std::string> missing =
        ColorPoints(scene, image_path, context, &model.reconstruction);
    if (missing.empty()) continue;
    context.Warning(std::to_string(missing.size()) +
                    " images could not be read for colours, the first is " +
                    missing.front());
  }
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

void WriteModels(const LoadedScene& loaded, const MapperResult& result,
                 const PositionPriors& priors, ModelFormat format,
                 const std::filesystem::path& output_path,
                 const Context& context) {
  for (size_t i = 0; i < result.models.size(); ++i) {
    const std::filesystem::path folder = output_path / std::to_string(i);
    const Reconstruction& model = result.models[i].reconstruction;
    std::filesystem::create_directory(folder);
    WriteModel(folder, loaded.scene, model, format, context);
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

}  // namespace

int MapDatabase(const MapperRun& run, const Context& context) {
  CheckPaths(run);
  ResolveMethod(run.mapper);  // before anything is read
  context.Debug("reading started");
  StagedOutput output(run.output_path);
  RunDescription description;
  description.version = MGSFM_VERSION;
  description.database_path = run.database_path;
  description.options_json = run.options_json;

  const StageTimer reading;
  LoadedScene loaded = LoadScene(run.database_path, run.loading, context);
  if (run.mapper.method == MapperMethod::kSingle) {
    loaded.scene = SeparateImages(std::move(loaded.scene));
    loaded.rig_source = "left out, each image by itself";
  }
  CheckFormat(loaded.scene, run.output_format);
  description.rig_source = loaded.rig_source;
  description.times.push_back(reading.Stop("reading"));
  const PositionPriors priors =
      ReadPositionPriors(loaded.scene, run.database_path, run.priors);
  const GravityPriors gravity =
      ReadGravity(loaded.scene, run.database_path, run.priors);
  LogInput(loaded, context);

  MapperResult result = RunMapper(loaded.scene, loaded.view_graph, run.mapper,
                                  context, priors, gravity);
  context.Debug("writing started");
  const StageTimer writing;
  if (!run.image_path.empty()) {
    Color(loaded.scene, run.image_path, context, &result);
  }
  WriteModels(loaded, result, priors, run.output_format, output.StagingDir(),
              context);
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
        "nothing could be reconstructed; see " +
            (std::filesystem::path(run.output_path) / "report.json").string());
    return kExitNotSolvable;
  }
  return kExitSuccess;
}

}  // namespace mgsfm
