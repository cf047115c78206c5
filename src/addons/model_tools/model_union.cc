// SPDX-License-Identifier: BSD-3-Clause
#include "model_tools/model_union.h"

#include <map>
#include <set>
#include <string>
#include <utility>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Keypoints of one image in two models differ by rounding, others by more.
constexpr double kMaxKeypointDistancePx = 1.0;

class UnionFinder {
 public:
  UnionFinder(const Scene& first, const Scene& second)
      : first_(first), second_(second) {
    union_.first_image.resize(second.images.size());
    union_.first_sensor.resize(second.sensors.size());
    union_.first_rig.resize(second.rigs.size());
    union_.first_frame.resize(second.frames.size());
  }

  ModelUnion Run() {
    FindImages();
    FindRigsByName();
    FindSensorsByName();
    FindFramesByName();
    CheckFrames();
    return std::move(union_);
  }

 private:
  void FindImages();
  void FindRigsByName();
  void FindSensorsByName();
  void FindFramesByName();
  void CheckFrames() const;
  void CheckImage(const Image& a, const Image& b) const;
  static std::set<std::string> SensorNames(const Scene& scene, const Rig& rig);
  static void Assign(int first, const std::string& problem,
                     std::optional<int>* place);

  const Scene& first_;
  const Scene& second_;
  ModelUnion union_;
};

void UnionFinder::Assign(int first, const std::string& problem,
                         std::optional<int>* place) {
  if (place->value_or(first) != first) throw Error(problem);
  *place = first;
}

void UnionFinder::CheckImage(const Image& a, const Image& b) const {
  const Camera& camera_a =
      first_.cameras[first_.sensors[a.sensor_idx].camera_idx];
  const Camera& camera_b =
      second_.cameras[second_.sensors[b.sensor_idx].camera_idx];
  if (camera_a.model != camera_b.model ||
      camera_a.width_px != camera_b.width_px ||
      camera_a.height_px != camera_b.height_px) {
    throw Error("image '" + a.name +
                "' has another camera model or size in the second model; merge "
                "models of the same images");
  }
  bool is_same = a.keypoints_px.size() == b.keypoints_px.size();
  for (size_t i = 0; is_same && i < a.keypoints_px.size(); ++i) {
    is_same = (a.keypoints_px[i] - b.keypoints_px[i]).norm() <=
              kMaxKeypointDistancePx;
  }
  if (!is_same) {
    throw Error("image '" + a.name +
                "' has other keypoints in the second model; merge models of "
                "one database");
  }
}

void UnionFinder::FindImages() {
  std::map<std::string, int> image_of_name;
  for (size_t i = 0; i < first_.images.size(); ++i) {
    image_of_name[first_.images[i].name] = static_cast<int>(i);
  }
  for (size_t i = 0; i < second_.images.size(); ++i) {
    const Image& b = second_.images[i];
    const auto found = image_of_name.find(b.name);
    if (found == image_of_name.end()) continue;
    const Image& a = first_.images[found->second];
    CheckImage(a, b);
    union_.first_image[i] = found->second;
    const std::string remedy =
        "; give both models the same rigs (rig_name_rule or rig_config_path)";
    Assign(a.sensor_idx,
           "images of camera '" + second_.sensors[b.sensor_idx].name +
               "', such as '" + b.name +
               "', are of several cameras in the first model" + remedy,
           &union_.first_sensor[b.sensor_idx]);
    Assign(first_.sensors[a.sensor_idx].rig_idx,
           "the rig of image '" + b.name +
               "' is several rigs in the first model" + remedy,
           &union_.first_rig[second_.sensors[b.sensor_idx].rig_idx]);
    Assign(a.frame_idx,
           "the frame of image '" + b.name +
               "' is several frames in the first model" + remedy,
           &union_.first_frame[b.frame_idx]);
  }
}

std::set<std::string> UnionFinder::SensorNames(const Scene& scene,
                                               const Rig& rig) {
  std::set<std::string> names;
  for (const int sensor_idx : rig.sensor_idxs) {
    names.insert(scene.sensors[sensor_idx].name);
  }
  return names;
}

// Rigs without common images are the same if their sensors have the same names.
void UnionFinder::FindRigsByName() {
  std::map<std::set<std::string>, std::vector<int>> rigs_of_names;
  for (size_t i = 0; i < first_.rigs.size(); ++i) {
    rigs_of_names[SensorNames(first_, first_.rigs[i])].push_back(
        static_cast<int>(i));
  }
  for (size_t i = 0; i < second_.rigs.size(); ++i) {
    if (union_.first_rig[i]) continue;
    const auto found =
        rigs_of_names.find(SensorNames(second_, second_.rigs[i]));
    if (found == rigs_of_names.end() || found->second.size() > 1) continue;
    union_.first_rig[i] = found->second.front();
  }
}

void UnionFinder::FindSensorsByName() {
  for (size_t i = 0; i < second_.sensors.size(); ++i) {
    const Sensor& sensor = second_.sensors[i];
    const auto rig = union_.first_rig[sensor.rig_idx];
    if (union_.first_sensor[i] || !rig) continue;
    for (const int sensor_idx : first_.rigs[*rig].sensor_idxs) {
      if (first_.sensors[sensor_idx].name == sensor.name) {
        union_.first_sensor[i] = sensor_idx;
      }
    }
  }
}

void UnionFinder::FindFramesByName() {
  std::map<std::pair<int, std::string>, int> frame_of_name;
  for (size_t i = 0; i < first_.frames.size(); ++i) {
    frame_of_name[{first_.frames[i].rig_idx, first_.frames[i].name}] =
        static_cast<int>(i);
  }
  for (size_t i = 0; i < second_.frames.size(); ++i) {
    const Frame& frame = second_.frames[i];
    const auto rig = union_.first_rig[frame.rig_idx];
    if (union_.first_frame[i] || !rig) continue;
    const auto found = frame_of_name.find({*rig, frame.name});
    if (found != frame_of_name.end()) union_.first_frame[i] = found->second;
  }
}

// A frame has at most one image of a sensor.
void UnionFinder::CheckFrames() const {
  std::map<std::pair<int, int>, int> image_of_place;
  for (size_t i = 0; i < first_.images.size(); ++i) {
    const Image& image = first_.images[i];
    image_of_place[{image.frame_idx, image.sensor_idx}] = static_cast<int>(i);
  }
  for (size_t i = 0; i < second_.images.size(); ++i) {
    const Image& image = second_.images[i];
    const auto frame = union_.first_frame[image.frame_idx];
    const auto sensor = union_.first_sensor[image.sensor_idx];
    if (union_.first_image[i] || !frame || !sensor) continue;
    const auto found = image_of_place.find({*frame, *sensor});
    if (found == image_of_place.end()) continue;
    throw Error("images '" + first_.images[found->second].name + "' and '" +
                image.name +
                "' have the same camera and frame; rename the images of one "
                "model");
  }
}

}  // namespace

ModelUnion FindUnion(const SceneModel& first, const SceneModel& second) {
  return UnionFinder(first.scene, second.scene).Run();
}

}  // namespace mgsfm
