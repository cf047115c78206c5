// SPDX-License-Identifier: BSD-3-Clause

#include "command.h"
#include "commands.h"
#include "files/file_operations.h"
#include "files/staged_output.h"
#include "mapper/stage.h"
#include "mapper_run.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/mapper/report.h"
#include "model_file.h"

namespace mgsfm {
namespace {

BundleAdjustmentOptions FixCameras() {
  BundleAdjustmentOptions options;
  options.refine_rig_from_world = false;
  options.refine_sensor_from_rig = RefineMode::kNo;
  options.refine_focal_length = RefineMode::kNo;
  options.refine_extra_params = RefineMode::kNo;
  return options;
}

struct PointTriangulatorOptions {
  Option<std::string> database_path{"database_path", "", Required(),
                                    "Read the verified matches of this COLMAP "
                                    "database, which is not changed."};
  Option<std::string> image_path{"image_path", "",
                                 "Color the points by the images in this "
                                 "folder. Without it, all points are black."};
  Option<std::string> input_path{
      "input_path", "", Required(),
      "Triangulate the points of the model in this folder, whose poses and "
      "intrinsics are fixed. Its images are matched with those of the database "
      "by name."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write the model and report.json into this folder. An earlier model is "
      "replaced when the new one is complete; other files stay. May be the "
      "input."};
  Option<bool> clear_points{"clear_points", true,
                            "Discard old points. 0: keep and extend them."};
  Option<ModelFormat> output_format = ModelFormatOption();
  SceneLoadingOptions loading;
  ViewGraphOptions view_graph;
  TrackOptions tracks;
  BundleAdjustmentOptions bundle_adjustment = FixCameras();

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, image_path, input_path, output_path, clear_points,
          output_format, loading);
    visit.Group("ViewGraph", view_graph);
    visit.Group("Tracks", tracks);
    visit.Group("BundleAdjustment", bundle_adjustment);
  }
};

int RunPointTriangulator(const PointTriangulatorOptions& options,
                         const Context& context) {
  CheckImagePath(options.image_path);
  StagedOutput output(*options.output_path, OutputKind::kModel);
  MapperRun run;
  run.database_path = options.database_path;
  run.input_path = options.input_path;
  run.loading = options.loading;
  run.options_json = OptionsToJsonOf(options);
  run.default_options_json = OptionsToJsonOf(PointTriangulatorOptions());
  RunDescription description = DescribeInput(run, context);

  const RunningStage reading("reading", context);
  const LoadedInput input =
      LoadMapperInput(run, {!options.clear_points, true}, context);
  const Scene& scene = input.mapper.scene;
  CheckFormat(scene, options.output_format);
  description.rig_source = input.rig_source;
  reading.Finish(&description.times);

  MapperOptions stages;
  stages.view_graph = options.view_graph;
  stages.tracks = options.tracks;
  stages.bundle_adjustment = options.bundle_adjustment;
  MapperResult result = TriangulatePoints(input.mapper, stages, context);
  if (result.models.empty()) {
    context.log(LogLevel::kError,
                "no point could be triangulated from the matches");
    return kExitNotSolvable;
  }
  const RunningStage writing("writing", context);
  ColorModels(scene, options.image_path, writing.context(), &result);
  const Reconstruction& model = result.models.front().reconstruction;
  WriteModelAndRig(output.StagingDir(), scene, model, options.output_format,
                   context);
  writing.Finish(&description.times);
  description.peak_memory_mib = PeakMemoryMib();
  WriteFile(
      output.StagingDir() / "report.json",
      MapperReportToJson(scene, input.mapper.view_graph, result, description));
  context.CheckInterrupted();
  output.Commit();
  context.Info(std::to_string(model.points.size()) + " points");
  LogMissingColors(options.image_path, context);
  return kExitSuccess;
}

}  // namespace

Command PointTriangulatorCommand() {
  return MakeCommand("point_triangulator",
                     "Triangulates the points of a model with known poses.",
                     RunPointTriangulator);
}

}  // namespace mgsfm
