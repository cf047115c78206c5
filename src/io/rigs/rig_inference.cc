// SPDX-License-Identifier: BSD-3-Clause
#include "rigs/rig_inference.h"

#include <algorithm>
#include <cctype>
#include <map>

#include "math/union_find.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// The folders that all images have in common, "a/b".
std::string CommonFolder(const RigInput& input,
                         const std::vector<int>& images) {
  std::vector<std::string> common =
      SplitPath(input.contents.images[images.front()].name);
  common.pop_back();
  for (const int image : images) {
    std::vector<std::string> folders =
        SplitPath(input.contents.images[image].name);
    folders.pop_back();
    const size_t size = std::min(common.size(), folders.size());
    const auto end =
        std::mismatch(common.begin(), common.begin() + size, folders.begin());
    common.erase(end.first, common.end());
  }
  std::string joined;
  for (const std::string& folder : common) {
    joined += (joined.empty() ? "" : "/") + folder;
  }
  return joined;
}

// Numbers the distinct strings in order of appearance.
class Numbering {
 public:
  int operator()(const std::string& key) {
    return numbers_.emplace(key, static_cast<int>(numbers_.size()))
        .first->second;
  }
  size_t size() const { return numbers_.size(); }

 private:
  std::map<std::string, int> numbers_;
};

}  // namespace

bool IsCalledLikeCamera(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  constexpr const char* kWords[] = {"cam",  "image", "left", "right",
                                    "lens", "front", "rear", "back"};
  return std::any_of(
      std::begin(kWords), std::end(kWords),
      [&](const char* word) { return name.find(word) != std::string::npos; });
}

std::vector<std::string> SplitPath(const std::string& name) {
  std::vector<std::string> components;
  size_t begin = 0;
  for (size_t end = name.find('/'); end != std::string::npos;
       end = name.find('/', begin)) {
    components.push_back(name.substr(begin, end - begin));
    begin = end + 1;
  }
  components.push_back(name.substr(begin));
  return components;
}

std::string WithoutExtension(const std::string& name) {
  const size_t dot = name.rfind('.');
  const size_t slash = name.rfind('/');
  const size_t file_begin = slash == std::string::npos ? 0 : slash + 1;
  if (dot == std::string::npos || dot <= file_begin) return name;
  return name.substr(0, dot);
}

std::optional<size_t> FindSensorName(const std::string& image_name,
                                     const std::string& sensor_name) {
  for (size_t begin = image_name.find(sensor_name); begin != std::string::npos;
       begin = image_name.find(sensor_name, begin + 1)) {
    const size_t end = begin + sensor_name.size();
    const bool starts = begin == 0 || image_name[begin - 1] == '/';
    const bool ends = end < image_name.size() && image_name[end] == '/';
    if (starts && ends) return begin;
  }
  if (image_name.compare(0, sensor_name.size(), sensor_name) == 0) return 0;
  return std::nullopt;
}

std::string NameWithoutSensor(const std::string& image_name,
                              const std::string& sensor_name) {
  std::string name = WithoutExtension(image_name);
  const auto begin = FindSensorName(name, sensor_name);
  if (!begin || sensor_name.empty()) return name;
  const size_t end = *begin + sensor_name.size();
  const bool is_folder = end < name.size() && name[end] == '/';
  return name.erase(*begin, sensor_name.size() + (is_folder ? 1 : 0));
}

bool HaveEqualIntrinsics(const Camera& a, const Camera& b) {
  return a.model == b.model && a.width_px == b.width_px &&
         a.height_px == b.height_px && a.params == b.params &&
         a.has_prior_focal_length == b.has_prior_focal_length;
}

void AssignSingleImages(const RigInput& input, const std::vector<int>& images,
                        RigAssignment* assignment) {
  std::map<int, std::vector<int>> images_of_camera;
  for (const int image : images) {
    images_of_camera[input.camera_of_image[image]].push_back(image);
  }
  for (const auto& [camera, images_of_one] : images_of_camera) {
    const int rig = static_cast<int>(assignment->rig_ids.size());
    const int sensor = static_cast<int>(assignment->sensors.size());
    assignment->rig_ids.emplace_back();
    assignment->sensors.emplace_back();
    assignment->sensors.back().rig = rig;
    assignment->sensors.back().name = CommonFolder(input, images_of_one);
    for (const int image : images_of_one) {
      assignment->sensor_of_image[image] = sensor;
      assignment->frame_of_image[image] =
          static_cast<int>(assignment->frames.size());
      assignment->frames.push_back(
          {rig,
           NameWithoutSensor(input.contents.images[image].name,
                             assignment->sensors[sensor].name),
           {}});
    }
  }
}

RigAssignment AssignByKeys(const RigInput& input,
                           const std::vector<ImageKeys>& keys) {
  const size_t num_images = keys.size();
  Numbering sensor_numbers;
  Numbering frame_numbers;
  std::vector<int> sensors(num_images);
  std::vector<int> frames(num_images);
  for (size_t i = 0; i < num_images; ++i) {
    sensors[i] = sensor_numbers(keys[i].sensor);
    frames[i] = frame_numbers(keys[i].frame);
  }
  UnionFind sets(sensor_numbers.size());
  std::vector<int> any_sensor_of_frame(frame_numbers.size(), -1);
  Mask shares_frames(sensor_numbers.size(), false);
  for (size_t i = 0; i < num_images; ++i) {
    int& other = any_sensor_of_frame[frames[i]];
    if (other >= 0 && other != sensors[i]) {
      sets.Union(sensors[i], other);
      shares_frames[sensors[i]] = shares_frames[other] = 1;
    }
    other = sensors[i];
  }
  RigAssignment assignment;
  assignment.sensor_of_image.resize(num_images);
  assignment.frame_of_image.resize(num_images);
  Numbering rigs;
  Numbering rig_sensors;
  Numbering rig_frames;
  std::vector<int> single_images;
  for (size_t i = 0; i < num_images; ++i) {
    if (shares_frames[sensors[i]] == 0) {
      single_images.push_back(static_cast<int>(i));
      continue;
    }
    const int rig = rigs(std::to_string(sets.Find(sensors[i])));
    const int sensor = rig_sensors(keys[i].sensor);
    const int frame = rig_frames(keys[i].frame);
    assignment.rig_ids.resize(rigs.size());
    assignment.sensors.resize(rig_sensors.size());
    assignment.sensors[sensor].rig = rig;
    assignment.sensors[sensor].name = keys[i].sensor_name;
    assignment.frames.resize(rig_frames.size());
    assignment.frames[frame].rig = rig;
    assignment.frames[frame].name = keys[i].frame_name;
    assignment.sensor_of_image[i] = sensor;
    assignment.frame_of_image[i] = frame;
  }
  AssignSingleImages(input, single_images, &assignment);
  return assignment;
}

}  // namespace mgsfm
