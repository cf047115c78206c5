// SPDX-License-Identifier: BSD-3-Clause
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "rigs/name_patterns.h"
#include "rigs/rig_inference.h"

namespace mgsfm {
namespace {

void AddRigs(const std::vector<RigConfig>& rigs, RigAssignment* assignment) {
  assignment->rig_ids.resize(rigs.size());
  for (size_t rig = 0; rig < rigs.size(); ++rig) {
    for (const RigConfigCamera& camera : rigs[rig].cameras) {
      RigAssignment::Sensor sensor;
      sensor.rig = static_cast<int>(rig);
      sensor.name = camera.image_prefix;
      if (!sensor.name.empty() && sensor.name.back() == '/') {
        sensor.name.pop_back();
      }
      sensor.is_reference = camera.is_reference;
      sensor.sensor_from_rig = camera.cam_from_rig;
      sensor.camera_model = camera.camera_model;
      sensor.camera_params = camera.camera_params;
      assignment->sensors.push_back(std::move(sensor));
    }
  }
}

[[noreturn]] void ThrowTwoCameras(const std::string& path,
                                  const std::string& image_name,
                                  const RigConfigCamera& camera1,
                                  const RigConfigCamera& camera2) {
  throw Error("rig configuration '" + path + "': image '" + image_name +
              "' fits both '" + camera1.NameRule() + "' and '" +
              camera2.NameRule() + "'; end prefixes that are folders with '/'");
}

// The sensor whose prefix or pattern the image has; nullopt if none.
std::optional<int> FindSensor(const std::string& image_name,
                              const std::vector<RigConfigCamera>& cameras,
                              const std::string& path) {
  std::optional<int> found;
  for (size_t i = 0; i < cameras.size(); ++i) {
    if (!FrameKeyOf(cameras[i], image_name)) continue;
    if (found) ThrowTwoCameras(path, image_name, cameras[*found], cameras[i]);
    found = static_cast<int>(i);
  }
  return found;
}

// Images whose names agree after the prefix, or at the stars of the pattern,
// form a frame.
void AddFramesByName(const RigInput& input,
                     const std::vector<RigConfigCamera>& cameras,
                     RigAssignment* assignment) {
  Numbering<std::pair<int, std::string>> numbers;
  for (size_t i = 0; i < input.contents.images.size(); ++i) {
    const int sensor = assignment->sensor_of_image[i];
    if (sensor < 0) continue;
    const RigConfigCamera& camera = cameras[sensor];
    const std::string key = *FrameKeyOf(camera, input.contents.images[i].name);
    const int rig = assignment->sensors[sensor].rig;
    assignment->frame_of_image[i] = numbers({rig, key});
    if (numbers.size() > assignment->frames.size()) {
      const bool has_extension = camera.image_pattern.empty();
      assignment->frames.push_back(
          {rig, has_extension ? WithoutExtension(key) : key, {}});
    }
  }
}

// Names sensors by their prefix, or by the part of the names with which the
// pattern distinguishes them.
void NamePatternSensors(const RigInput& input,
                        const std::vector<RigConfigCamera>& cameras,
                        RigAssignment* assignment) {
  NameGroups names;
  for (size_t i = 0; i < input.contents.images.size(); ++i) {
    const int sensor = assignment->sensor_of_image[i];
    if (sensor < 0 || cameras[sensor].image_pattern.empty()) continue;
    names[sensor].push_back(input.contents.images[i].name);
  }
  const auto parts = names.empty() ? std::nullopt : FindTellingParts(names);
  size_t k = 0;
  for (const auto& entry : names) {
    assignment->sensors[entry.first].name =
        parts ? (*parts)[k++] : cameras[entry.first].image_pattern;
  }
}

// Warns if several cameras of a rig have images, but no frame has two of them.
void WarnIfNamesShareNoFrame(const RigInput& input,
                             const RigAssignment& assignment,
                             const Context& context) {
  std::vector<size_t> frame_sizes(assignment.frames.size(), 0);
  std::map<int, std::set<int>> sensors_of_rig;
  std::vector<ImageKeys> keys;
  for (size_t i = 0; i < assignment.frame_of_image.size(); ++i) {
    const int s = assignment.sensor_of_image[i];
    if (s < 0) continue;
    const RigAssignment::Sensor& sensor = assignment.sensors[s];
    if (++frame_sizes[assignment.frame_of_image[i]] > 1) return;
    sensors_of_rig[sensor.rig].insert(s);
    keys.push_back(
        {std::to_string(sensor.rig), std::to_string(s), "", sensor.name, ""});
  }
  const bool has_rig = AnyOf(
      sensors_of_rig, [](const auto& rig) { return rig.second.size() > 1; });
  if (!has_rig) return;
  std::optional<std::string> suggestion;
  if (keys.size() == input.contents.images.size()) {
    suggestion = SuggestFramesByTime(input, keys);
  }
  context.Warning(suggestion.value_or(
      assignment.source +
      ": no two cameras of a rig have images of the same name, so that each "
      "image is a frame of its own; give images of one frame the same name, or "
      "set frame_max_time_difference_s"));
}

}  // namespace

RigAssignment AssignByConfig(const RigInput& input,
                             const std::vector<RigConfig>& rigs,
                             const std::string& path, const TimedImages* times,
                             const Context& context) {
  RigAssignment assignment;
  assignment.source = "rig configuration '" + path + "'";
  AddRigs(rigs, &assignment);
  std::vector<RigConfigCamera> cameras;
  for (const RigConfig& rig : rigs) {
    cameras.insert(cameras.end(), rig.cameras.begin(), rig.cameras.end());
  }
  const std::vector<ImageRow>& images = input.contents.images;
  assignment.sensor_of_image.resize(images.size(), -1);
  assignment.frame_of_image.resize(images.size(), -1);
  Mask has_images(cameras.size(), false);
  std::vector<int> single_images;
  for (size_t i = 0; i < images.size(); ++i) {
    if (const auto sensor = FindSensor(images[i].name, cameras, path)) {
      has_images[*sensor] = true;
      assignment.sensor_of_image[i] = *sensor;
    } else {
      single_images.push_back(static_cast<int>(i));
    }
  }
  for (size_t i = 0; i < cameras.size(); ++i) {
    if (has_images[i] == 0 && !input.contents.is_selection) {
      throw Error(
          "rig configuration '" + path + "': no image of " + input.Name() +
          (cameras[i].image_pattern.empty() ? " starts with the prefix '"
                                            : " fits the pattern '") +
          cameras[i].NameRule() + "'; correct it, or remove the camera");
    }
  }
  NamePatternSensors(input, cameras, &assignment);
  if (times != nullptr) {
    PairByTime(input, *times, context, &assignment);
  } else {
    AddFramesByName(input, cameras, &assignment);
    WarnIfNamesShareNoFrame(input, assignment, context);
  }
  AssignSingleImages(input, single_images, &assignment);
  return assignment;
}

}  // namespace mgsfm
