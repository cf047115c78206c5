// SPDX-License-Identifier: BSD-3-Clause
#include <sys/resource.h>

#include <filesystem>

#include "command.h"
#include "commands.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/io/model_io.h"
#include "mgsfm/io/output_file.h"
#include "mgsfm/io/point_colors.h"
#include "mgsfm/io/rig_config.h"
#include "mgsfm/io/scene_loading.h"
#include "mgsfm/io/staged_output.h"
#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/pipeline/report.h"

namespace mgsfm {
namespace {

struct MapperCommandOptions {
  std::string database_path;
  std::string output_path;
  std::string image_path;
  ModelFormat output_format = ModelFormat::kBinary;
  SceneLoadingOptions loading;
  MapperOptions mapper;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("database_path", self.database_path, Required(), "",
          "COLMAP database with verified matches. It is only read.");
    visit("output_path", self.output_path, Required(), "",
          "Folder for the models 0, 1, ... and report.json. Earlier ones are "
          "replaced when the new ones are whole.");
    visit("image_path", self.image_path, AnyValue(), "",
          "Folder of the images, to colour the points.");
    visit("output_format", self.output_format, AnyValue(), "",
          "Of the models: binary or text.");
    SceneLoadingOptions::Describe(self.loading, visit);
    MapperOptions::Describe(self.mapper, visit);
  }
};

double PeakMemoryMib() {
  rusage usage{};
  if (getrusage(RUSAGE_SELF, &usage) != 0) return 0.0;
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

void CheckPaths(const MapperCommandOptions& options) {
  if (!options.image_path.empty() &&
      !std::filesystem::is_directory(options.image_path)) {
    throw Error("--image_path '" + options.image_path + "' is no folder");
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
                 ModelFormat format, const std::filesystem::path& output_path,
                 const Context& context) {
  for (size_t i = 0; i < result.models.size(); ++i) {
    const std::filesystem::path folder = output_path / std::to_string(i);
    const Reconstruction& model = result.models[i].reconstruction;
    std::filesystem::create_directory(folder);
    WriteModel(folder, loaded.scene, model, format, context);
    WriteRigConfig((folder / "rig_config.json").string(), loaded.scene, model);
    LogModel(loaded.scene, result.models[i], i, context);
  }
}

int RunMapperCommand(const MapperCommandOptions& options,
                     const Context& context) {
  CheckPaths(options);
  context.Debug("reading started");
  StagedOutput output(options.output_path);
  RunDescription run;
  run.version = MGSFM_VERSION;
  run.database_path = options.database_path;
  run.options_json = OptionsToJsonOf(options);

  const Timer reading;
  const LoadedScene loaded =
      LoadScene(options.database_path, options.loading, context);
  CheckFormat(loaded.scene, options.output_format);
  run.rig_source = loaded.rig_source;
  run.times.push_back({"reading", reading.Seconds()});
  LogInput(loaded, context);

  MapperResult result =
      RunMapper(loaded.scene, loaded.view_graph, options.mapper, context);
  context.Debug("writing started");
  const Timer writing;
  if (!options.image_path.empty()) {
    Color(loaded.scene, options.image_path, context, &result);
  }
  WriteModels(loaded, result, options.output_format, output.StagingDir(),
              context);
  run.times.push_back({"writing", writing.Seconds()});
  run.peak_memory_mib = PeakMemoryMib();
  WriteFile(output.StagingDir() / "report.json",
            MapperReportToJson(loaded.scene, loaded.view_graph, result, run));
  context.CheckInterrupted();
  output.Commit();
  if (result.models.empty()) {
    context.log(LogLevel::kError,
                "nothing could be reconstructed; see " +
                    (std::filesystem::path(options.output_path) / "report.json")
                        .string());
    return kExitNotSolvable;
  }
  return kExitSuccess;
}

}  // namespace

Command MapperCommand() {
  return MakeCommand("mapper",
                     "Reconstructs models from the matches of a database.",
                     RunMapperCommand);
}

}  // namespace mgsfm
