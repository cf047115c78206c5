// SPDX-License-Identifier: BSD-3-Clause
#include "tool_model.h"

#include <algorithm>
#include <utility>

#include "mgsfm/models/model_scene.h"
#include "mgsfm/priors/pose_priors.h"
#include "mgsfm/rigs/rig_config.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

// Whether the tables of rigs and frames say more than the images do.
bool HasRigs(const PoseModel& poses) {
  return std::any_of(poses.frames.begin(), poses.frames.end(),
                     [](const ModelFrame& frame) {
                       return frame.image_ids.size() > 1;
                     }) ||
         std::any_of(poses.rigs.begin(), poses.rigs.end(),
                     [](const RigRow& rig) { return rig.sensors.size() > 1; });
}

}  // namespace

ToolModel MakeToolModel(const Model& model, const std::string& path,
                        const ToolRigOptions& rigs, const Context& context) {
  SceneLoadingOptions loading;
  loading.rig_config_path = rigs.rig_config_path;
  loading.rig_name_rule = rigs.rig_name_rule;
  if (*rigs.rig_name_rule == "auto" && !HasRigs(model.poses)) {
    loading.rig_name_rule = "none";
  }
  ModelScene loaded = MakeModelScene(model, path, loading, context);
  return {{std::move(loaded.scene), std::move(loaded.reconstruction)}, {}};
}

ToolModel ReadToolModel(const std::string& path, const ToolRigOptions& rigs,
                        const Context& context) {
  ToolModel model = MakeToolModel(ReadModel(path), path, rigs, context);
  model.origin_wgs84 = ReadGeoOrigin(path);
  return model;
}

void WriteToolModel(const ToolModel& model, ModelFormat format,
                    const Context& context, StagedOutput* output) {
  const std::filesystem::path folder = output->StagingDir();
  const Scene& scene = model.model.scene;
  const Reconstruction& reconstruction = model.model.reconstruction;
  WriteModel(folder, scene, reconstruction, format, context);
  WriteRigConfig((folder / "rig_config.json").string(), scene, reconstruction);
  if (model.origin_wgs84) {
    WriteGeoOrigin((folder / "geo_origin.json").string(), *model.origin_wgs84);
  }
  context.CheckInterrupted();
  output->Commit();
}

std::string DescribeSize(const SceneModel& model) {
  return DescribeSize(AnalyzeModel(model));
}

std::string DescribeSize(const ModelStatistics& statistics) {
  return std::to_string(statistics.num_frames) + " frames, " +
         std::to_string(statistics.num_images) + " images and " +
         std::to_string(statistics.num_points) + " points";
}

}  // namespace mgsfm
