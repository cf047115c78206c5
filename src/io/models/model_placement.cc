// SPDX-License-Identifier: BSD-3-Clause
#include "models/model_placement.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "base/text_tools.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"
#include "models/model_checks.h"
#include "scene/intrinsics_check.h"
#include "scene/item_lists.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Extracting the features of an image twice gives equal keypoints up to
// rounding. A match with features of another image is off by many pixels.
constexpr double kMaxKeypointDistancePx = 1.0;
// Rounding in double precision.
constexpr double kRigidTolerance = 1e-6;

std::string DescribeCamera(const Camera& camera) {
  return std::string(InfoOf(camera.model).name) + " of " +
         SizeText(camera.width_px, camera.height_px) + " px";
}

class ModelPlacer {
 public:
  ModelPlacer(const Model& model, const fs::path& folder,
              const std::string& database_path, Scene* scene)
      : model_(model),
        folder_(folder),
        database_("the database '" + database_path + "'"),
        scene_(*scene),
        image_of_id_(IndexById(model.poses.images)) {}

  PlacedModel Run(bool with_points) {
    MatchImages();
    TakeCameras();
    CheckFrames();
    ChooseReferences();
    Reconstruction& placed = placed_.reconstruction;
    const RigPoses poses(folder_, cam_from_world_, scene_);
    PlaceSensors(poses, &placed.sensor_from_rig);
    poses.CheckKnownSensors(placed.sensor_from_rig);
    placed.cameras = scene_.cameras;
    placed.rig_from_world = poses.PlaceFrames(placed.sensor_from_rig);
    if (with_points) TakePoints();
    JudgeRigidity();
    return std::move(placed_);
  }

 private:
  void MatchImages();
  void TakeCameras();
  void CheckFrames() const;
  void ChooseReferences();
  void PlaceSensors(const RigPoses& by_images, OptionalPoses* poses);
  void TakePoints();
  void CheckObservation(const ModelObservation& observation) const;
  void JudgeRigidity();
  const std::string& NameOf(int image_idx) const {
    return scene_.images[image_idx].name;
  }

  const Model& model_;
  const fs::path& folder_;
  const std::string database_;
  Scene& scene_;
  std::vector<int> image_idx_of_;  // per image of the model
  const std::map<ImageId, int> image_of_id_;
  std::vector<std::optional<Rigid3>> cam_from_world_;  // per image of the scene
  PlacedModel placed_;
};

void ModelPlacer::MatchImages() {
  const std::vector<ModelImage>& images = model_.poses.images;
  if (images.empty()) ThrowModelError(folder_, "it has no image");
  CheckModelTables(model_.poses, folder_);
  const auto image_idx_of_name = IndexByName(scene_.images);
  cam_from_world_.resize(scene_.images.size());
  const std::string* missing = nullptr;
  for (const ModelImage& image : images) {
    const auto found = image_idx_of_name.find(image.name);
    if (found == image_idx_of_name.end()) {
      if (missing == nullptr) missing = &image.name;
      continue;
    }
    image_idx_of_.push_back(found->second);
    cam_from_world_[found->second] = image.cam_from_world;
  }
  if (image_idx_of_.empty()) {
    ThrowModelError(folder_, "none of its images, as '" + *missing +
                                 "', is in " + database_ +
                                 "; give the database that holds them");
  }
  if (missing != nullptr) {
    ThrowModelError(folder_, "its image '" + *missing + "' is not in " +
                                 database_ +
                                 "; extract and match its features there, or "
                                 "remove it from the model");
  }
}

void ModelPlacer::TakeCameras() {
  const auto camera_of_id = IndexById(model_.cameras);
  Mask is_taken(scene_.cameras.size(), false);
  for (size_t i = 0; i < image_idx_of_.size(); ++i) {
    const Image& image = scene_.images[image_idx_of_[i]];
    const Camera& camera =
        model_.cameras[camera_of_id.at(model_.poses.images[i].camera_id)];
    Camera& in_scene = scene_.cameras[image.camera_idx];
    const bool is_known =
        in_scene.has_prior_focal_length && !HasLensOfExif(in_scene);
    if ((is_known && camera.model != in_scene.model) ||
        camera.width_px != in_scene.width_px ||
        camera.height_px != in_scene.height_px) {
      ThrowModelError(folder_, "image '" + image.name + "' has a camera " +
                                   DescribeCamera(camera) + ", in " +
                                   database_ + " " + DescribeCamera(in_scene) +
                                   "; give the database that the model was "
                                   "made from");
    }
    if (is_taken[image.camera_idx]) continue;
    is_taken[image.camera_idx] = true;
    in_scene.model = camera.model;
    in_scene.params = camera.params;
    in_scene.has_prior_focal_length = true;
  }
}

void ModelPlacer::CheckFrames() const {
  for (const ModelFrame& frame : model_.poses.frames) {
    std::optional<int> first;
    for (const ImageId id : frame.image_ids) {
      const auto image = image_of_id_.find(id);
      if (image == image_of_id_.end()) continue;
      const int image_idx = image_idx_of_[image->second];
      if (!first) first = image_idx;
      if (scene_.images[image_idx].frame_idx ==
          scene_.images[*first].frame_idx) {
        continue;
      }
      ThrowModelError(folder_, "its images '" + NameOf(*first) + "' and '" +
                                   NameOf(image_idx) +
                                   "' belong to one frame, but not in " +
                                   database_ +
                                   "; set rig_config_path, to the folder of "
                                   "the model for instance, or "
                                   "rig_name_rule");
    }
  }
}

void ModelPlacer::ChooseReferences() {
  std::vector<int> num_images(scene_.sensors.size(), 0);
  for (const int image_idx : image_idx_of_) {
    ++num_images[scene_.images[image_idx].sensor_idx];
  }
  for (Rig& rig : scene_.rigs) {
    if (num_images[rig.ref_sensor_idx] > 0) continue;
    const int best = *std::max_element(
        rig.sensor_idxs.begin(), rig.sensor_idxs.end(),
        [&](int a, int b) { return num_images[a] < num_images[b]; });
    if (num_images[best] == 0) continue;
    const std::optional<Rigid3> new_from_old =
        scene_.sensors[best].sensor_from_rig;
    for (const int sensor_idx : rig.sensor_idxs) {
      auto& known = scene_.sensors[sensor_idx].sensor_from_rig;
      if (!new_from_old) {
        known.reset();
      } else if (known) {
        known = *known * new_from_old->Inverse();
      }
    }
    scene_.sensors[best].sensor_from_rig = Rigid3();
    rig.ref_sensor_idx = best;
  }
}

// Uses the rigs of the model that have both the sensor and the reference.
void ModelPlacer::PlaceSensors(const RigPoses& by_images,
                               OptionalPoses* poses) {
  std::map<std::pair<RigId, CameraId>, std::optional<Rigid3>> pose_in_model;
  for (const RigRow& rig : model_.poses.rigs) {
    for (const RigSensorRow& sensor : rig.sensors) {
      pose_in_model[{rig.id, sensor.camera_id}] = sensor.sensor_from_rig;
    }
  }
  // Rig in the model and pose there, per sensor of the scene.
  std::vector<std::optional<std::pair<RigId, Rigid3>>> in_model(
      scene_.sensors.size());
  for (const ModelFrame& frame : model_.poses.frames) {
    for (const ImageId id : frame.image_ids) {
      const auto image = image_of_id_.find(id);
      if (image == image_of_id_.end()) continue;
      const auto pose = pose_in_model.find(
          {frame.rig_id, model_.poses.images[image->second].camera_id});
      if (pose == pose_in_model.end() || !pose->second) continue;
      auto& place =
          in_model[scene_.images[image_idx_of_[image->second]].sensor_idx];
      if (!place) place = std::make_pair(frame.rig_id, *pose->second);
    }
  }
  Mask rig_is_in_model(scene_.rigs.size(), false);
  for (const int image_idx : image_idx_of_) {
    const int frame_idx = scene_.images[image_idx].frame_idx;
    rig_is_in_model[scene_.frames[frame_idx].rig_idx] = true;
  }
  poses->resize(scene_.sensors.size());
  for (size_t i = 0; i < scene_.sensors.size(); ++i) {
    const int ref_idx = scene_.rigs[scene_.sensors[i].rig_idx].ref_sensor_idx;
    if (!rig_is_in_model[scene_.sensors[i].rig_idx]) continue;
    if (static_cast<int>(i) == ref_idx) {
      (*poses)[i] = Rigid3();
    } else if (in_model[i] && in_model[ref_idx] &&
               in_model[i]->first == in_model[ref_idx]->first) {
      (*poses)[i] = in_model[i]->second * in_model[ref_idx]->second.Inverse();
    }
  }
  by_images.EstimateSensors(poses);
}

void ModelPlacer::CheckObservation(const ModelObservation& observation) const {
  const int image = image_of_id_.at(observation.image_id);
  const int image_idx = image_idx_of_[image];
  const uint32_t keypoint_idx = observation.keypoint_idx;
  const auto& keypoints_px = scene_.images[image_idx].keypoints_px;
  const bool is_there = keypoint_idx < keypoints_px.size() &&
                        (keypoints_px[keypoint_idx].cast<double>() -
                         model_.keypoints[image][keypoint_idx].position_px)
                                .norm() <= kMaxKeypointDistancePx;
  if (is_there) return;
  ThrowModelError(folder_, "keypoint " + std::to_string(keypoint_idx) +
                               " of image '" + NameOf(image_idx) +
                               "' is not that of " + database_ +
                               "; give the database that the model was made "
                               "from, or make new points with "
                               "point_triangulator");
}

void ModelPlacer::TakePoints() {
  if (model_.points.empty()) {
    ThrowModelError(folder_,
                    "it has no points, which tell where new images are; make "
                    "them with point_triangulator");
  }
  for (const ModelPoint& point : model_.points) {
    for (const ModelObservation& o : point.track) CheckObservation(o);
  }
  placed_.reconstruction.points = PointsOf(model_, image_idx_of_);
}

void ModelPlacer::JudgeRigidity() {
  Eigen::AlignedBox3d box;
  for (const auto& pose : cam_from_world_) {
    if (pose) box.extend(pose->Center());
  }
  const double max_distance = kRigidTolerance * box.diagonal().norm() + 1e-12;
  for (size_t i = 0; i < cam_from_world_.size(); ++i) {
    if (!cam_from_world_[i]) continue;
    const Rigid3 placed =
        *placed_.reconstruction.CamFromWorld(scene_, static_cast<int>(i));
    const Rigid3& expected = *cam_from_world_[i];
    if (AngleBetween(placed.rotation, expected.rotation) > kRigidTolerance ||
        (placed.Center() - expected.Center()).norm() > max_distance) {
      placed_.is_rigid = false;
    }
  }
}

}  // namespace

PlacedModel PlaceModel(const Model& model, const fs::path& folder,
                       const std::string& database_path, bool with_points,
                       Scene* scene) {
  return ModelPlacer(model, folder, database_path, scene).Run(with_points);
}

}  // namespace mgsfm
