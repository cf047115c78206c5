// SPDX-License-Identifier: BSD-3-Clause
#include "model_file.h"

#include <utility>

#include "base/format.h"
#include "base/ranges.h"
#include "mgsfm/models/model_scene.h"
#include "mgsfm/priors/pose_priors.h"
#include "mgsfm/rigs/rig_config.h"

namespace mgsfm {
namespace {

// Whether the rigs and frames contain more information than the images.
bool HasRigs(const PoseModel& poses) {
  return AnyOf(poses.frames,
               [](const ModelFrame& frame) {
                 return frame.image_ids.size() > 1;
               }) ||
         AnyOf(poses.rigs,
               [](const RigRow& rig) { return rig.sensors.size() > 1; });
}

}  // namespace

ModelFile MakeModelFile(const Model& model, const std::string& path,
                        const ModelRigOptions& rigs, const Context& context) {
  SceneLoadingOptions loading;
  loading.rig_config_path = rigs.rig_config_path;
  loading.rig_name_rule = rigs.rig_name_rule;
  if (*rigs.rig_name_rule == "auto" && !HasRigs(model.poses)) {
    loading.rig_name_rule = "none";
  }
  ModelScene loaded = MakeModelScene(model, path, loading, context);
  return {{std::move(loaded.scene), std::move(loaded.reconstruction)}, {}};
}

ModelFile ReadModelFile(const std::string& path, const ModelRigOptions& rigs,
                        const Context& context) {
  ModelFile model = MakeModelFile(ReadModel(path), path, rigs, context);
  model.origin_wgs84 = ReadGeoOrigin(path);
  return model;
}

void WriteModelAndRig(const std::filesystem::path& folder, const Scene& scene,
                      const Reconstruction& reconstruction, ModelFormat format,
                      const Context& context) {
  WriteModel(folder, scene, reconstruction, format, context);
  WriteRigConfig((folder / "rig_config.json").string(), scene, reconstruction);
}

void WriteModelFile(const ModelFile& model, ModelFormat format,
                    const Context& context, StagedOutput* output) {
  const std::filesystem::path folder = output->StagingDir();
  WriteModelAndRig(folder, model.model.scene, model.model.reconstruction,
                   format, context);
  if (model.origin_wgs84) {
    WriteGeoOrigin((folder / "geo_origin.json").string(), *model.origin_wgs84);
  }
  context.CheckInterrupted();
  output->Commit();
}

std::string EditModel(const ModelEditOptions& options, const Context& context,
                      const std::function<void(ModelFile*)>& edit) {
  StagedOutput output(*options.output_path, OutputKind::kModel);
  ModelFile model = ReadModelFile(options.input_path, options.rigs, context);
  CheckFormat(model.model.scene, options.output_format);
  edit(&model);
  WriteModelFile(model, options.output_format, context, &output);
  return DescribeSize(model.model);
}

std::string DescribeSize(const SceneModel& model) {
  const ModelStatistics statistics = AnalyzeModel(model);
  return Formatted("%zu frames, %zu images and %zu points",
                   statistics.num_frames, statistics.num_images,
                   statistics.num_points);
}

}  // namespace mgsfm
