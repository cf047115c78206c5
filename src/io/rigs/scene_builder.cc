// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "base/grouped_warnings.h"
#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "rigs/rig_inference.h"
#include "scene/intrinsics_check.h"

namespace mgsfm {
namespace {

void CheckFrames(const RigInput& input, const RigAssignment& assignment) {
  std::map<std::pair<int, int>, int> image_of;  // by frame and sensor
  for (size_t i = 0; i < input.contents.images.size(); ++i) {
    const int image = static_cast<int>(i);
    const int frame = assignment.frame_of_image[i];
    const int sensor = assignment.sensor_of_image[i];
    const auto [other, is_new] =
        image_of.emplace(std::make_pair(frame, sensor), image);
    if (!is_new) {
      throw Error(input.Name() + ": images '" +
                  input.contents.images[other->second].name + "' and '" +
                  input.contents.images[i].name +
                  "' belong to one camera and one frame according to " +
                  assignment.source +
                  "; they cannot be taken at the same time");
    }
  }
}

// Makes `best` the reference and known poses relative to it.
void ReplaceReference(const std::vector<int>& sensors, const Context& context,
                      RigAssignment::Sensor* best, RigAssignment* assignment) {
  const std::optional<Rigid3> new_from_old = best->sensor_from_rig;
  for (const int i : sensors) {
    RigAssignment::Sensor& sensor = assignment->sensors[i];
    if (sensor.is_reference) {
      context.Warning("the reference sensor of a rig has no images; '" +
                      best->name + "' replaces it");
    }
    sensor.is_reference = false;
    // No sensor with images has a known pose if new_from_old is missing.
    if (sensor.sensor_from_rig && new_from_old) {
      sensor.sensor_from_rig =
          *sensor.sensor_from_rig * new_from_old->Inverse();
    }
  }
  best->is_reference = true;
}

// Ensures that the reference of the rig of these sensors has images: the given
// one, otherwise by known pose, number of images and name.
void ChooseReference(const std::vector<int>& sensors,
                     const std::vector<int>& num_images, const Context& context,
                     RigAssignment* assignment) {
  RigAssignment::Sensor* best = nullptr;
  const auto quality = [&](const RigAssignment::Sensor& sensor) {
    const size_t number = &sensor - assignment->sensors.data();
    return std::make_tuple(sensor.is_reference,
                           sensor.sensor_from_rig.has_value(),
                           num_images[number]);
  };
  for (const int i : sensors) {
    RigAssignment::Sensor& sensor = assignment->sensors[i];
    if (num_images[i] == 0) continue;
    if (best == nullptr || quality(sensor) > quality(*best) ||
        (quality(sensor) == quality(*best) && sensor.name < best->name)) {
      best = &sensor;
    }
  }
  if (best == nullptr) return;
  if (!best->is_reference) ReplaceReference(sensors, context, best, assignment);
  best->sensor_from_rig = Rigid3();
}

void ChooseReferences(const Context& context, RigAssignment* assignment) {
  std::vector<int> num_images(assignment->sensors.size());
  for (const int sensor : assignment->sensor_of_image) ++num_images[sensor];
  std::vector<std::vector<int>> sensors_of_rig(assignment->rig_ids.size());
  for (size_t i = 0; i < assignment->sensors.size(); ++i) {
    sensors_of_rig[assignment->sensors[i].rig].push_back(static_cast<int>(i));
  }
  for (const std::vector<int>& sensors : sensors_of_rig) {
    ChooseReference(sensors, num_images, context, assignment);
  }
}

class SceneBuilder {
 public:
  SceneBuilder(RigInput input, RigAssignment assignment, const Context& context)
      : input_(std::move(input)),
        assignment_(std::move(assignment)),
        context_(context) {}

  Scene Build() {
    CheckFrames(input_, assignment_);
    ChooseReferences(context_, &assignment_);
    JoinCameras();
    for (size_t i = 0; i < input_.contents.images.size(); ++i) {
      AddImage(static_cast<int>(i));
    }
    CheckConsistent(scene_);
    return std::move(scene_);
  }

 private:
  [[noreturn]] void Throw(const std::string& problem) const {
    throw Error(input_.Name() + ": " + problem);
  }
  const ImageRow& ImageAt(int image) const {
    return input_.contents.images[image];
  }

  void JoinCameras();
  void AddImage(int image);
  int AddCamera(int sensor);
  void CheckAssignedIntrinsics(int sensor, const Camera& camera) const;
  CameraId UnusedCameraId() const;

  RigInput input_;
  RigAssignment assignment_;
  const Context& context_;
  std::vector<int> camera_of_sensor_;  // position in input_.contents.cameras
  Scene scene_;

  // The intrinsics of a sensor: from the input, or a replacement.
  using CameraKey =
      std::tuple<int, std::optional<CameraModelId>, std::vector<double>>;
  Numbering<CameraKey> camera_idxs_;
  Numbering<int> sensor_idxs_, frame_idxs_, rig_idxs_;
};

// A sensor has one camera: the camera of its first image, if those of its other
// images are equal.
void SceneBuilder::JoinCameras() {
  const size_t num_sensors = assignment_.sensors.size();
  std::vector<int> first_image(num_sensors, -1);
  std::vector<std::set<int>> cameras(num_sensors);
  camera_of_sensor_.assign(num_sensors, -1);
  for (size_t i = 0; i < input_.contents.images.size(); ++i) {
    const int image = static_cast<int>(i);
    const int sensor = assignment_.sensor_of_image[i];
    if (first_image[sensor] < 0) first_image[sensor] = image;
    const int first = first_image[sensor];
    camera_of_sensor_[sensor] = input_.camera_of_image[first];
    cameras[sensor].insert(input_.camera_of_image[i]);
    if (!HaveEqualIntrinsics(input_.CameraOf(first), input_.CameraOf(image))) {
      Throw("images '" + ImageAt(first).name + "' and '" + ImageAt(image).name +
            "' belong to one camera '" + assignment_.sensors[sensor].name +
            "' of a rig according to " + assignment_.source +
            ", but have different intrinsics; extract features with "
            "ImageReader.single_camera_per_folder, or set rig_name_rule");
    }
  }
  GroupedWarnings warnings;
  for (size_t i = 0; i < num_sensors; ++i) {
    if (cameras[i].size() > 1) {
      warnings.Add("the " + std::to_string(cameras[i].size()) +
                   " equal cameras of '" + assignment_.sensors[i].name +
                   "' are merged");
    }
  }
  warnings.Log(context_);
}

CameraId SceneBuilder::UnusedCameraId() const {
  uint32_t max_id = 0;
  for (const Camera& camera : input_.contents.cameras) {
    max_id = std::max(max_id, camera.id.value());
  }
  for (const Camera& camera : scene_.cameras) {
    max_id = std::max(max_id, camera.id.value());
  }
  return CameraId(max_id + 1);
}

// Throws Error for intrinsics of images of another size, unless the input has
// the same principal point, as for cropped images.
void SceneBuilder::CheckAssignedIntrinsics(int sensor,
                                           const Camera& camera) const {
  const auto problem = FindIntrinsicsProblem(camera);
  if (!problem) return;
  const auto of_input =
      FindIntrinsicsProblem(input_.contents.cameras[camera_of_sensor_[sensor]]);
  const bool is_contradicted =
      problem->is_misread && !(of_input && of_input->is_misread);
  if (!problem->is_certain && !is_contradicted) return;
  Throw("camera '" + assignment_.sensors[sensor].name + "' of " +
        assignment_.source + ' ' + problem->text +
        "; give the intrinsics of images of this size");
}

int SceneBuilder::AddCamera(int sensor) {
  const RigAssignment::Sensor& assigned = assignment_.sensors[sensor];
  const int camera_idx =
      camera_idxs_({camera_of_sensor_[sensor], assigned.camera_model,
                    assigned.camera_params});
  if (camera_idxs_.size() == scene_.cameras.size()) return camera_idx;
  Camera camera = input_.contents.cameras[camera_of_sensor_[sensor]];
  if (assigned.camera_model) {
    camera.model = *assigned.camera_model;
    camera.params = assigned.camera_params;
    camera.has_prior_focal_length = true;
    CheckAssignedIntrinsics(sensor, camera);
  }
  if (AnyOf(scene_.cameras,
            [&](const Camera& other) { return other.id == camera.id; })) {
    camera.id = UnusedCameraId();
  }
  scene_.cameras.push_back(std::move(camera));
  return camera_idx;
}

void SceneBuilder::AddImage(int image_idx) {
  ImageRow& row = input_.contents.images[image_idx];
  const int assigned_sensor = assignment_.sensor_of_image[image_idx];
  const int assigned_frame = assignment_.frame_of_image[image_idx];
  const RigAssignment::Sensor& assigned = assignment_.sensors[assigned_sensor];
  const int rig_idx = rig_idxs_(assigned.rig);
  if (rig_idxs_.size() > scene_.rigs.size()) {
    const auto id = assignment_.rig_ids[assigned.rig];
    scene_.rigs.push_back(
        {id.value_or(RigId(static_cast<uint32_t>(rig_idx + 1))), 0, {}});
  }
  const int sensor_idx = sensor_idxs_(assigned_sensor);
  if (sensor_idxs_.size() > scene_.sensors.size()) {
    scene_.sensors.push_back({assigned.name, rig_idx,
                              AddCamera(assigned_sensor),
                              assigned.sensor_from_rig});
    scene_.rigs[rig_idx].sensor_idxs.push_back(sensor_idx);
    if (assigned.is_reference) scene_.rigs[rig_idx].ref_sensor_idx = sensor_idx;
  }
  const int frame_idx = frame_idxs_(assigned_frame);
  if (frame_idxs_.size() > scene_.frames.size()) {
    const RigAssignment::Frame& frame = assignment_.frames[assigned_frame];
    scene_.frames.push_back(
        {frame.id.value_or(FrameId(row.id.value())), frame.name, rig_idx, {}});
  }
  Frame& frame = scene_.frames[frame_idx];
  frame.image_idxs.push_back(image_idx);
  if (!assignment_.frames[assigned_frame].id) {
    // No other frame can have the smallest id of its images.
    frame.id = std::min(frame.id, FrameId(row.id.value()));
  }
  scene_.images.push_back({row.id, std::move(row.name),
                           scene_.sensors[sensor_idx].camera_idx, sensor_idx,
                           frame_idx, std::move(row.keypoints_px)});
}

}  // namespace

Scene BuildScene(RigInput input, RigAssignment assignment,
                 const Context& context) {
  return SceneBuilder(std::move(input), std::move(assignment), context).Build();
}

}  // namespace mgsfm
