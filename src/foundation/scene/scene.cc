// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/scene/scene.h"

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "base/natural_order.h"
#include "base/parallel.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

template <class Array>
void CheckIndex(int idx, const Array& array) {
  MGSFM_CHECK_GE(idx, 0);
  MGSFM_CHECK_LT(static_cast<size_t>(idx), array.size());
}

void CheckRigs(const Scene& scene) {
  std::set<int> sensor_is_listed;
  for (size_t rig_idx = 0; rig_idx < scene.rigs.size(); ++rig_idx) {
    const Rig& rig = scene.rigs[rig_idx];
    bool has_reference = false;
    for (const int sensor_idx : rig.sensor_idxs) {
      CheckIndex(sensor_idx, scene.sensors);
      MGSFM_CHECK_MSG(sensor_is_listed.insert(sensor_idx).second,
                      scene.sensors[sensor_idx].name);
      MGSFM_CHECK_EQ(static_cast<size_t>(scene.sensors[sensor_idx].rig_idx),
                     rig_idx);
      has_reference |= sensor_idx == rig.ref_sensor_idx;
    }
    MGSFM_CHECK(has_reference);
    const auto& pose = scene.sensors[rig.ref_sensor_idx].sensor_from_rig;
    MGSFM_CHECK(pose.has_value());
    MGSFM_CHECK_EQ(pose->translation.norm(), 0.0);
    MGSFM_CHECK_EQ(pose->rotation.vec().norm(), 0.0);
  }
  MGSFM_CHECK_EQ(sensor_is_listed.size(), scene.sensors.size());
}

void CheckFrames(const Scene& scene) {
  size_t num_images = 0;
  for (size_t frame_idx = 0; frame_idx < scene.frames.size(); ++frame_idx) {
    const Frame& frame = scene.frames[frame_idx];
    CheckIndex(frame.rig_idx, scene.rigs);
    std::set<int> sensor_idxs;
    for (const int image_idx : frame.image_idxs) {
      CheckIndex(image_idx, scene.images);
      const Image& image = scene.images[image_idx];
      MGSFM_CHECK_EQ(static_cast<size_t>(image.frame_idx), frame_idx);
      CheckIndex(image.sensor_idx, scene.sensors);
      const Sensor& sensor = scene.sensors[image.sensor_idx];
      MGSFM_CHECK_EQ(sensor.rig_idx, frame.rig_idx);
      MGSFM_CHECK_EQ(sensor.camera_idx, image.camera_idx);
      MGSFM_CHECK_MSG(sensor_idxs.insert(image.sensor_idx).second, image.name);
    }
    num_images += frame.image_idxs.size();
  }
  MGSFM_CHECK_EQ(num_images, scene.images.size());
}

// The frames of the rig of the named frame, from this frame on. Throws Error
// unless there are frames before it.
std::vector<int> FramesFrom(const Scene& scene, const std::string& frame_name) {
  const auto found = std::find_if(
      scene.frames.begin(), scene.frames.end(),
      [&](const Frame& frame) { return frame.name == frame_name; });
  if (found == scene.frames.end()) {
    throw Error("there is no frame '" + frame_name +
                "' to split a rig at; frames have names such as '" +
                scene.frames.front().name + "'");
  }
  std::vector<int> of_rig;
  for (const int frame_idx : OrderOfFrames(scene)) {
    if (scene.frames[frame_idx].rig_idx == found->rig_idx) {
      of_rig.push_back(frame_idx);
    }
  }
  const auto begin =
      std::find(of_rig.begin(), of_rig.end(), found - scene.frames.begin());
  if (begin == of_rig.begin()) {
    throw Error("the rig has no frame before '" + frame_name +
                "' to split it at; name a later frame");
  }
  return {begin, of_rig.end()};
}

bool IsSingle(const Scene& scene, const Frame& frame) {
  return scene.rigs[frame.rig_idx].sensor_idxs.size() == 1;
}

// Frames of different single cameras may have the same name.
const std::string& NameInSequence(const Scene& scene, int frame_idx) {
  const Frame& frame = scene.frames[frame_idx];
  return IsSingle(scene, frame) ? scene.images[frame.image_idxs.front()].name
                                : frame.name;
}

// Numbers the sequences as defined for OrderOfFrames.
std::vector<int> SequenceOfFrames(const Scene& scene) {
  std::vector<int> sequences(scene.frames.size());
  std::map<std::pair<int, std::string>, int> numbers;
  for (const Image& image : scene.images) {
    const Frame& frame = scene.frames[image.frame_idx];
    const auto key = IsSingle(scene, frame)
                         ? std::make_pair(-1, FolderOfName(image.name))
                         : std::make_pair(frame.rig_idx, std::string());
    sequences[image.frame_idx] =
        numbers.emplace(key, static_cast<int>(numbers.size())).first->second;
  }
  return sequences;
}

RigId UnusedRigId(const Scene& scene) {
  uint32_t max_id = 0;
  for (const Rig& rig : scene.rigs) max_id = std::max(max_id, rig.id.value());
  return RigId(max_id + 1);
}

}  // namespace

void CheckConsistent(const Scene& scene) {
  for (const Camera& camera : scene.cameras) {
    const CameraModelInfo* info =
        FindCameraModel(static_cast<int32_t>(camera.model));
    MGSFM_CHECK(info != nullptr);
    MGSFM_CHECK_EQ(camera.params.size(), static_cast<size_t>(info->num_params));
  }
  for (const Sensor& sensor : scene.sensors) {
    CheckIndex(sensor.rig_idx, scene.rigs);
    CheckIndex(sensor.camera_idx, scene.cameras);
  }
  CheckRigs(scene);
  CheckFrames(scene);
}

double TimeOfFrame(const Scene& scene, int frame_idx) {
  double sum_s = 0.0;
  const std::vector<int>& image_idxs = scene.frames[frame_idx].image_idxs;
  for (const int image_idx : image_idxs) {
    const Image& image = scene.images[image_idx];
    MGSFM_CHECK_MSG(image.timestamp_s.has_value(), image.name);
    if (scene.IsReference(image.sensor_idx)) return *image.timestamp_s;
    sum_s += *image.timestamp_s;
  }
  return sum_s / static_cast<double>(image_idxs.size());
}

std::vector<int> OrderOfFrames(const Scene& scene) {
  const std::vector<int> sequences = SequenceOfFrames(scene);
  Mask has_times(scene.frames.size(), true);  // per sequence
  for (const Image& image : scene.images) {
    if (!image.timestamp_s) has_times[sequences[image.frame_idx]] = false;
  }
  std::vector<double> times_s(scene.frames.size(), 0.0);
  std::vector<int> order = Indices(scene.frames.size());
  for (const int i : order) {
    if (has_times[sequences[i]]) times_s[i] = TimeOfFrame(scene, i);
  }
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    if (sequences[a] != sequences[b]) return sequences[a] < sequences[b];
    if (times_s[a] != times_s[b]) return times_s[a] < times_s[b];
    return IsNaturallyBefore(NameInSequence(scene, a),
                             NameInSequence(scene, b));
  });
  return order;
}

std::vector<int> SortFrames(Scene* scene) {
  std::vector<int> order = OrderOfFrames(*scene);
  std::vector<Frame> frames;
  for (const int frame_idx : order) {
    for (const int image_idx : scene->frames[frame_idx].image_idxs) {
      scene->images[image_idx].frame_idx = static_cast<int>(frames.size());
    }
    frames.push_back(std::move(scene->frames[frame_idx]));
  }
  scene->frames = std::move(frames);
  return order;
}

std::string CameraLabel(const Scene& scene, int camera_idx) {
  std::string label =
      "camera " + std::to_string(scene.cameras[camera_idx].id.value());
  const char* separator = " (";
  for (const Sensor& sensor : scene.sensors) {
    if (sensor.camera_idx != camera_idx || sensor.name.empty()) continue;
    label += separator + ("'" + sensor.name + "'");
    separator = ", ";
  }
  return label.back() == '\'' ? label + ")" : label;
}

Scene SplitRig(Scene scene, const std::string& frame_name) {
  const std::vector<int> frame_idxs = FramesFrom(scene, frame_name);
  const int old_rig_idx = scene.frames[frame_idxs.front()].rig_idx;
  const int new_rig_idx = static_cast<int>(scene.rigs.size());
  Rig new_rig{UnusedRigId(scene), 0, {}};
  std::map<int, int> new_sensor_idxs;  // by the old ones
  for (const int frame_idx : frame_idxs) {
    Frame& frame = scene.frames[frame_idx];
    for (const int image_idx : frame.image_idxs) {
      int& sensor_idx = scene.images[image_idx].sensor_idx;
      const auto [it, is_new] = new_sensor_idxs.emplace(
          sensor_idx, static_cast<int>(scene.sensors.size()));
      if (is_new) {
        Sensor sensor = scene.sensors[sensor_idx];
        sensor.rig_idx = new_rig_idx;
        sensor.sensor_from_rig.reset();
        scene.sensors.push_back(std::move(sensor));
        new_rig.sensor_idxs.push_back(it->second);
      }
      sensor_idx = it->second;
    }
    frame.rig_idx = new_rig_idx;
  }
  const auto reference =
      new_sensor_idxs.find(scene.rigs[old_rig_idx].ref_sensor_idx);
  new_rig.ref_sensor_idx = reference != new_sensor_idxs.end()
                               ? reference->second
                               : new_rig.sensor_idxs.front();
  scene.sensors[new_rig.ref_sensor_idx].sensor_from_rig = Rigid3();
  scene.rigs.push_back(std::move(new_rig));
  return scene;
}

Scene SeparateImages(Scene scene) {
  scene.rigs.clear();
  scene.frames.clear();
  for (const int s : Indices(scene.sensors.size())) {
    scene.sensors[s].rig_idx = s;
    scene.sensors[s].sensor_from_rig = Rigid3();
    scene.rigs.push_back({RigId(static_cast<uint32_t>(s + 1)), s, {s}});
  }
  for (const int i : Indices(scene.images.size())) {
    Image& image = scene.images[i];
    image.frame_idx = i;
    scene.frames.push_back(
        {FrameId(image.id.value()), image.name, image.sensor_idx, {i}});
  }
  return scene;
}

KeypointRays ComputeKeypointRays(
    const Camera& camera, const std::vector<Eigen::Vector2f>& keypoints_px) {
  KeypointRays rays;
  rays.rays.reserve(keypoints_px.size());
  rays.is_valid.reserve(keypoints_px.size());
  for (const Eigen::Vector2f& keypoint_px : keypoints_px) {
    rays.Append(RayFromPixel(camera, keypoint_px.cast<double>()));
  }
  return rays;
}

Bearings ComputeBearings(const Scene& scene, const std::vector<Camera>& cameras,
                         int num_threads) {
  Bearings bearings;
  bearings.images.resize(scene.images.size());
  ParallelFor(
      scene.images.size(), num_threads,
      [&](size_t image_idx) {
        const Image& image = scene.images[image_idx];
        bearings.images[image_idx] =
            ComputeKeypointRays(cameras[image.camera_idx], image.keypoints_px);
      },
      1);
  return bearings;
}

Bearings ComputeBearings(const Scene& scene, int num_threads) {
  return ComputeBearings(scene, scene.cameras, num_threads);
}

}  // namespace mgsfm
