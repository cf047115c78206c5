// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "io/rigs/frames_by_time.h"
#include "io/rigs/rig_inference.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

bool StartsWith(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

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

[[noreturn]] void ThrowTwoPrefixes(const std::string& path,
                                   const std::string& image_name,
                                   const std::string& prefix1,
                                   const std::string& prefix2) {
  throw Error("rig configuration '" + path + "': image '" + image_name +
              "' starts with both prefixes '" + prefix1 + "' and '" + prefix2 +
              "'; end prefixes that are folders with '/'");
}

// The sensor whose prefix the image has; nullopt if none.
std::optional<int> FindSensor(const std::string& image_name,
                              const std::vector<std::string>& prefixes,
                              const std::string& path) {
  std::optional<int> found;
  for (size_t i = 0; i < prefixes.size(); ++i) {
    if (!StartsWith(image_name, prefixes[i])) continue;
    if (found) {
      ThrowTwoPrefixes(path, image_name, prefixes[*found], prefixes[i]);
    }
    found = static_cast<int>(i);
  }
  return found;
}

// Images whose names agree after the prefix make a frame.
void AddFramesByName(const RigInput& input,
                     const std::vector<std::string>& prefixes,
                     RigAssignment* assignment) {
  std::map<std::pair<int, std::string>, int> frames;
  for (size_t i = 0; i < input.contents.images.size(); ++i) {
    const int sensor = assignment->sensor_of_image[i];
    if (sensor < 0) continue;
    const std::string& name = input.contents.images[i].name;
    const std::string& prefix = prefixes[sensor];
    const std::string key =
        prefix.empty() ? name : name.substr(name.rfind(prefix) + prefix.size());
    const int rig = assignment->sensors[sensor].rig;
    const auto [frame, is_new] = frames.emplace(
        std::make_pair(rig, key), static_cast<int>(assignment->frames.size()));
    if (is_new) assignment->frames.push_back({rig, WithoutExtension(key), {}});
    assignment->frame_of_image[i] = frame->second;
  }
}

// Several cameras of one rig have images, but no frame has two of them.
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
  const bool has_rig =
      std::any_of(sensors_of_rig.begin(), sensors_of_rig.end(),
                  [](const auto& rig) { return rig.second.size() > 1; });
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

void AddFramesByTime(const RigInput& input, const FrameTimes& times,
                     const Context& context, RigAssignment* assignment) {
  std::vector<TimedSensor> sensors;
  for (const RigAssignment::Sensor& sensor : assignment->sensors) {
    sensors.push_back({sensor.name, sensor.rig, sensor.is_reference});
  }
  const FramesByTime found =
      FindFramesByTime(sensors, assignment->sensor_of_image, times);
  ReportFramesByTime(input, sensors, assignment->sensor_of_image, found, times,
                     context);
  for (const FramesByTime::Frame& frame : found.frames) {
    assignment->frames.push_back({frame.rig, frame.name, {}});
  }
  assignment->frame_of_image = found.frame_of_image;
}

}  // namespace

RigAssignment AssignByConfig(const RigInput& input,
                             const std::vector<RigConfig>& rigs,
                             const std::string& path, const FrameTimes* times,
                             const Context& context) {
  RigAssignment assignment;
  assignment.source = "rig configuration '" + path + "'";
  AddRigs(rigs, &assignment);
  std::vector<std::string> prefixes;
  for (const RigConfig& rig : rigs) {
    for (const RigConfigCamera& camera : rig.cameras) {
      prefixes.push_back(camera.image_prefix);
    }
  }
  const std::vector<ImageRow>& images = input.contents.images;
  assignment.sensor_of_image.resize(images.size(), -1);
  assignment.frame_of_image.resize(images.size(), -1);
  Mask has_images(prefixes.size(), false);
  std::vector<int> single_images;
  for (size_t i = 0; i < images.size(); ++i) {
    if (const auto sensor = FindSensor(images[i].name, prefixes, path)) {
      has_images[*sensor] = true;
      assignment.sensor_of_image[i] = *sensor;
    } else {
      single_images.push_back(static_cast<int>(i));
    }
  }
  for (size_t i = 0; i < prefixes.size(); ++i) {
    if (has_images[i] == 0 && !input.contents.is_selection) {
      throw Error("rig configuration '" + path + "': no image of " +
                  input.Name() + " starts with the prefix '" + prefixes[i] +
                  "'");
    }
  }
  if (times != nullptr) {
    AddFramesByTime(input, *times, context, &assignment);
  } else {
    AddFramesByName(input, prefixes, &assignment);
    WarnIfNamesShareNoFrame(input, assignment, context);
  }
  AssignSingleImages(input, single_images, &assignment);
  return assignment;
}

}  // namespace mgsfm
