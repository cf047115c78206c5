// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/models/model_scene.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "models/model_checks.h"
#include "models/rows_to_scene.h"
#include "scene/item_lists.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

DatabaseContents MakeRows(const Model& model, const fs::path& folder) {
  DatabaseContents contents;
  contents.path = folder.string();
  contents.cameras = model.cameras;
  for (Camera& camera : contents.cameras) camera.has_prior_focal_length = true;
  for (size_t i = 0; i < model.poses.images.size(); ++i) {
    const ModelImage& image = model.poses.images[i];
    ImageRow row{image.id, image.name, image.camera_id, {}};
    row.keypoints_px.reserve(model.keypoints[i].size());
    for (const ModelKeypoint& keypoint : model.keypoints[i]) {
      row.keypoints_px.emplace_back(keypoint.position_px.cast<float>());
    }
    contents.images.push_back(std::move(row));
  }
  AddModelTables(model.poses, &contents);
  return contents;
}

// Poses computed from image poses differ by rounding from the frame poses of
// the model. Keeps the latter, so that a model that is written again does not
// change.
void KeepFramePoses(const PoseModel& poses, const Scene& scene,
                    std::vector<std::optional<Rigid3>>* rig_from_world) {
  // Thousands of roundings in double precision. Any other difference of two
  // poses is far larger.
  constexpr double kMaxRounding = 1e-12;
  std::map<ImageId, const Rigid3*> pose_of_image;
  for (const ModelFrame& frame : poses.frames) {
    for (const ImageId id : frame.image_ids) {
      pose_of_image[id] = &frame.rig_from_world;
    }
  }
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    std::optional<Rigid3>& pose = (*rig_from_world)[f];
    const int image_idx = scene.frames[f].image_idxs.front();
    const auto kept = pose_of_image.find(scene.images[image_idx].id);
    if (!pose || kept == pose_of_image.end()) continue;
    const Rigid3& of_model = *kept->second;
    const double angle =
        (pose->rotation.coeffs() - of_model.rotation.coeffs()).norm();
    const double distance = (pose->translation - of_model.translation).norm();
    if (angle < kMaxRounding &&
        distance < kMaxRounding * (1.0 + pose->translation.norm())) {
      pose = of_model;
    }
  }
}

// Warns if frames differ: frames of several images in a model show which images
// were taken together.
void WarnIfFramesDiffer(const PoseModel& poses, const Scene& scene,
                        const fs::path& folder, const Context& context) {
  std::map<ImageId, FrameId> frame_in_model;
  for (const ModelFrame& frame : poses.frames) {
    for (const ImageId id : frame.image_ids) {
      frame_in_model.emplace(id, frame.id);
    }
  }
  std::map<FrameId, std::set<int>> frames_in_scene;
  for (const Image& image : scene.images) {
    const auto found = frame_in_model.find(image.id);
    if (found == frame_in_model.end()) return;
    frames_in_scene[found->second].insert(image.frame_idx);
  }
  const auto is_split = [&](const Image& image) {
    return frames_in_scene.at(frame_in_model.at(image.id)).size() > 1;
  };
  const auto first =
      std::find_if(scene.images.begin(), scene.images.end(), is_split);
  if (first == scene.images.end()) return;
  context.Warning(
      "model '" + folder.string() + "': the images of one frame, such as '" +
      first->name + "', are in several frames by the given rigs (" +
      std::to_string(std::count_if(first, scene.images.end(), is_split)) +
      " of " + std::to_string(scene.images.size()) +
      " images); check the rigs unless you want other frames");
}

}  // namespace

ModelScene MakeModelScene(const Model& model, const fs::path& folder,
                          const SceneLoadingOptions& options,
                          const Context& context) {
  if (model.poses.images.empty()) ThrowModelError(folder, "it has no image");
  CheckObservations(model, folder, context);
  const bool has_config = options.HasKnownRig();
  if (!has_config && *options.rig_name_rule == "auto" &&
      !options.PairsFramesByTime()) {
    CheckModelTables(model.poses, folder);
  }
  SceneOfRows rows =
      BuildSceneOfRows("model", MakeRows(model, folder), options, context);
  ModelScene result{std::move(rows.scene), {}, std::move(rows.rig_source)};
  Scene& scene = result.scene;
  Reconstruction& reconstruction = result.reconstruction;
  reconstruction.cameras = scene.cameras;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    std::optional<Rigid3>& known = scene.sensors[i].sensor_from_rig;
    reconstruction.sensor_from_rig.push_back(known);
    if (!has_config && !scene.IsReference(static_cast<int>(i))) known.reset();
  }
  // Scene and model are both sorted by name.
  for (size_t i = 0; i < scene.images.size(); ++i) {
    MGSFM_CHECK_MSG(scene.images[i].id == model.poses.images[i].id,
                    scene.images[i].name);
  }
  std::vector<std::optional<Rigid3>> cam_from_world;
  for (const ModelImage& image : model.poses.images) {
    cam_from_world.emplace_back(image.cam_from_world);
  }
  const RigPoses poses(folder, cam_from_world, scene);
  if (has_config) {
    WarnIfFramesDiffer(model.poses, scene, folder, context);
    poses.CheckKnownSensors();
  }
  poses.EstimateSensors(&reconstruction.sensor_from_rig);
  reconstruction.rig_from_world =
      poses.PlaceFrames(reconstruction.sensor_from_rig);
  KeepFramePoses(model.poses, scene, &reconstruction.rig_from_world);
  reconstruction.points = PointsOf(model, Indices(scene.images.size()));
  return result;
}

ModelScene LoadModelScene(const fs::path& folder,
                          const SceneLoadingOptions& options,
                          const Context& context) {
  return MakeModelScene(ReadModel(folder), folder, options, context);
}

}  // namespace mgsfm
