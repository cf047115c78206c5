// SPDX-License-Identifier: BSD-3-Clause
#include "io/models/rows_to_scene.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <numeric>
#include <utility>

#include "io/rigs/rig_inference.h"
#include "io/rigs/scene_builder.h"
#include "mgsfm/base/error.h"
#include "mgsfm/io/models/model_scene.h"
#include "mgsfm/io/rigs/rig_config.h"

namespace mgsfm {
namespace {

// Reads the rigs of a file or of a folder: of its rig_config.json or, if it has
// none, of the sparse model there, which any program may have written.
std::vector<RigConfig> ReadRigConfigOrModel(const std::string& path,
                                            const Context& context) {
  namespace fs = std::filesystem;
  if (!fs::is_directory(path)) return ReadRigConfig(path);
  const fs::path config = fs::path(path) / "rig_config.json";
  if (fs::exists(config)) return ReadRigConfig(config.string());
  const ModelScene model = LoadModelScene(path, {}, context);
  return MakeRigConfigs(model.scene, model.reconstruction);
}

RigInput MakeRigInput(const std::string& kind, DatabaseContents contents) {
  RigInput input;
  input.kind = kind;
  std::sort(
      contents.images.begin(), contents.images.end(),
      [](const ImageRow& a, const ImageRow& b) { return a.name < b.name; });
  std::map<CameraId, int> camera_of_id;
  for (size_t i = 0; i < contents.cameras.size(); ++i) {
    camera_of_id[contents.cameras[i].id] = static_cast<int>(i);
  }
  for (const ImageRow& image : contents.images) {
    const auto camera = camera_of_id.find(image.camera_id);
    MGSFM_CHECK_MSG(camera != camera_of_id.end(), image.name);
    input.camera_of_image.push_back(camera->second);
  }
  input.contents = std::move(contents);
  return input;
}

RigAssignment AssignAllSingle(const RigInput& input) {
  RigAssignment assignment;
  std::vector<int> images(input.contents.images.size());
  std::iota(images.begin(), images.end(), 0);
  assignment.sensor_of_image.resize(images.size());
  assignment.frame_of_image.resize(images.size());
  AssignSingleImages(input, images, &assignment);
  assignment.source = "none (single images)";
  return assignment;
}

RigAssignment AssignRigs(const RigInput& input,
                         const SceneLoadingOptions& options,
                         const Context& context) {
  if (!options.rig_config_path->empty()) {
    return AssignByConfig(
        input, ReadRigConfigOrModel(options.rig_config_path, context),
        options.rig_config_path);
  }
  if (*options.rig_name_rule == "none") return AssignAllSingle(input);
  if (*options.rig_name_rule != "auto") {
    return AssignByRule(input, options.rig_name_rule);
  }
  if (auto assignment = AssignByTables(input)) return *std::move(assignment);
  return AssignByFolders(input);
}

}  // namespace

SceneOfRows BuildSceneOfRows(const std::string& kind, DatabaseContents contents,
                             const SceneLoadingOptions& options,
                             const Context& context) {
  RigInput input = MakeRigInput(kind, std::move(contents));
  RigAssignment assignment = AssignRigs(input, options, context);
  SceneOfRows result;
  result.rig_source = assignment.source;
  result.scene = BuildScene(std::move(input), std::move(assignment), context);
  return result;
}

}  // namespace mgsfm
