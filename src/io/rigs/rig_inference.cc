// SPDX-License-Identifier: BSD-3-Clause
#include "rigs/rig_inference.h"

#include <algorithm>
#include <set>

#include "base/ranges.h"
#include "base/text_tools.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "rigs/name_patterns.h"
#include "scene/item_lists.h"

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
  return Joined(common, "/");
}

constexpr const char* kRemedy =
    "; configure the rigs again, set rig_config_path, or treat images as "
    "single with rig_name_rule none";

class TableAssigner {
 public:
  explicit TableAssigner(const RigInput& input) : input_(input) {
    const size_t num_images = input.contents.images.size();
    assignment_.source = "rigs and frames of the " + input.kind;
    assignment_.sensor_of_image.resize(num_images, -1);
    assignment_.frame_of_image.resize(num_images, -1);
  }

  RigAssignment Assign() {
    for (const RigRow& rig : input_.contents.rigs) AddRig(rig);
    const auto image_of_id = IndexById(input_.contents.images);
    for (const FrameRow& frame : input_.contents.frames) {
      AddFrame(frame, image_of_id);
    }
    CheckAllAssigned();
    NameSensors();
    NameFrames();
    return std::move(assignment_);
  }

 private:
  [[noreturn]] void Throw(const std::string& problem) const {
    throw Error(input_.Name() + ": " + problem + kRemedy);
  }
  void AddRig(const RigRow& rig);
  void AddFrame(const FrameRow& frame,
                const std::map<ImageId, int>& image_of_id);
  void CheckCamera(const FrameDataRow& data, int image,
                   const std::string& frame) const;
  void CheckAllAssigned() const;
  // Names sensors by the first of these that is unique for each: a level of
  // folders, a part of the image names, their common start.
  void NameSensors();
  void NameFrames();
  // The folder of each sensor; nullopt if a sensor has several at this level.
  std::optional<std::vector<std::string>> FoldersAtLevel(size_t level) const;
  // The parts of names that only the images of one sensor have.
  std::optional<std::vector<std::string>> TellingParts() const;
  // The common start of the names of a sensor's images: as whole folders, or
  // as text without the digits at its end.
  std::vector<std::string> CommonStarts(bool whole_folders) const;

  const RigInput& input_;
  RigAssignment assignment_;
  std::map<RigId, int> rig_of_id_;
  std::map<std::pair<RigId, CameraId>, int> sensor_of_ids_;
};

void TableAssigner::AddRig(const RigRow& row) {
  const int rig = static_cast<int>(assignment_.rig_ids.size());
  rig_of_id_.emplace(row.id, rig);
  assignment_.rig_ids.emplace_back(row.id);
  for (const RigSensorRow& sensor_row : row.sensors) {
    const auto number = static_cast<int>(assignment_.sensors.size());
    sensor_of_ids_.emplace(std::make_pair(row.id, sensor_row.camera_id),
                           number);
    RigAssignment::Sensor sensor;
    sensor.rig = rig;
    sensor.is_reference =
        row.ref_camera_id && sensor_row.camera_id == *row.ref_camera_id;
    sensor.sensor_from_rig = sensor_row.sensor_from_rig;
    assignment_.sensors.push_back(std::move(sensor));
  }
}

void TableAssigner::AddFrame(const FrameRow& row,
                             const std::map<ImageId, int>& image_of_id) {
  const std::string what = "frame " + std::to_string(row.id.value());
  const auto rig = rig_of_id_.find(row.rig_id);
  if (rig == rig_of_id_.end()) {
    Throw(what + " belongs to rig " + std::to_string(row.rig_id.value()) +
          ", which does not exist");
  }
  const int frame = static_cast<int>(assignment_.frames.size());
  assignment_.frames.push_back({rig->second, "", row.id});
  for (const FrameDataRow& data : row.data) {
    const auto sensor = sensor_of_ids_.find({row.rig_id, data.camera_id});
    const auto image = image_of_id.find(data.image_id);
    if (sensor == sensor_of_ids_.end()) {
      Throw(what + " has an image of camera " +
            std::to_string(data.camera_id.value()) +
            ", which is not in its rig " + std::to_string(row.rig_id.value()));
    }
    if (image == image_of_id.end()) {
      Throw(what + " has the image " + std::to_string(data.image_id.value()) +
            ", which does not exist");
    }
    if (assignment_.frame_of_image[image->second] >= 0) {
      Throw("image '" + input_.contents.images[image->second].name +
            "' is in two frames");
    }
    CheckCamera(data, image->second, what);
    assignment_.sensor_of_image[image->second] = sensor->second;
    assignment_.frame_of_image[image->second] = frame;
  }
}

// COLMAP copies a camera that two sensors share, but keeps it in the images.
void TableAssigner::CheckCamera(const FrameDataRow& data, int image,
                                const std::string& frame) const {
  const Camera& of_image = input_.CameraOf(image);
  const auto& cameras = input_.contents.cameras;
  const auto of_frame = std::find_if(
      cameras.begin(), cameras.end(),
      [&](const Camera& camera) { return camera.id == data.camera_id; });
  if (of_frame == cameras.end() || HaveEqualIntrinsics(*of_frame, of_image)) {
    return;
  }
  Throw("image '" + input_.contents.images[image].name + "' is of camera " +
        std::to_string(of_image.id.value()) + ", but in " + frame +
        " of camera " + std::to_string(data.camera_id.value()) +
        ", which has other intrinsics");
}

void TableAssigner::CheckAllAssigned() const {
  const std::vector<int>& frames = assignment_.frame_of_image;
  const auto first = std::find(frames.begin(), frames.end(), -1);
  if (first == frames.end()) return;
  const auto num_left = std::count(first, frames.end(), -1);
  Throw(std::to_string(num_left) + " of its " + std::to_string(frames.size()) +
        " images are in no frame of its rigs, such as '" +
        input_.contents.images[first - frames.begin()].name + "'");
}

std::vector<std::string> TableAssigner::CommonStarts(bool whole_folders) const {
  std::vector<std::optional<std::string>> starts(assignment_.sensors.size());
  for (size_t i = 0; i < input_.contents.images.size(); ++i) {
    std::string name = input_.contents.images[i].name;
    if (whole_folders) name = name.substr(0, name.rfind('/') + 1);
    auto& start = starts[assignment_.sensor_of_image[i]];
    if (!start) start = name;
    const size_t size = std::min(start->size(), name.size());
    const auto end =
        std::mismatch(name.begin(), name.begin() + size, start->begin());
    start->erase(end.second, start->end());
  }
  std::vector<std::string> names;
  for (auto& start : starts) {
    std::string name = start.value_or("");
    const size_t end = whole_folders ? name.rfind('/')
                                     : name.find_last_not_of("0123456789") + 1;
    names.push_back(name.substr(0, end == std::string::npos ? 0 : end));
    if (!names.back().empty() && names.back().back() == '/') {
      names.back().pop_back();
    }
  }
  return names;
}

std::optional<std::vector<std::string>> TableAssigner::FoldersAtLevel(
    size_t level) const {
  std::vector<std::optional<std::string>> folders(assignment_.sensors.size());
  for (size_t i = 0; i < input_.contents.images.size(); ++i) {
    const std::vector<std::string> path =
        SplitPath(input_.contents.images[i].name);
    if (level + 1 >= path.size()) return std::nullopt;
    auto& folder = folders[assignment_.sensor_of_image[i]];
    if (folder && *folder != path[level]) return std::nullopt;
    folder = path[level];
  }
  return Transformed(folders,
                     [](const auto& folder) { return folder.value_or(""); });
}

std::optional<std::vector<std::string>> TableAssigner::TellingParts() const {
  NameGroups names_of_sensor;
  for (size_t i = 0; i < input_.contents.images.size(); ++i) {
    names_of_sensor[assignment_.sensor_of_image[i]].push_back(
        input_.contents.images[i].name);
  }
  const auto parts = FindTellingParts(names_of_sensor);
  if (!parts) return std::nullopt;
  std::vector<std::string> names(assignment_.sensors.size());
  auto part = parts->begin();
  for (const auto& entry : names_of_sensor) names[entry.first] = *part++;
  return names;
}

void TableAssigner::NameSensors() {
  const std::set<int> used(assignment_.sensor_of_image.begin(),
                           assignment_.sensor_of_image.end());
  std::vector<std::vector<std::string>> candidates;
  const size_t depth = SplitPath(input_.contents.images.front().name).size();
  for (size_t level = 0; level + 1 < depth; ++level) {
    if (auto names = FoldersAtLevel(level)) candidates.push_back(*names);
  }
  candidates.push_back(CommonStarts(true));
  if (auto names = TellingParts()) candidates.push_back(*names);
  candidates.push_back(CommonStarts(false));
  for (const std::vector<std::string>& names : candidates) {
    std::set<std::string> distinct;
    for (const int sensor : used) distinct.insert(names[sensor]);
    if (distinct.size() != used.size()) continue;
    for (const int sensor : used) {
      assignment_.sensors[sensor].name = names[sensor];
    }
    return;
  }
  // Names without a meaning: numbers in the order of the first images.
  std::set<int> named;
  for (const int sensor : assignment_.sensor_of_image) {
    if (!named.insert(sensor).second) continue;
    assignment_.sensors[sensor].name = "sensor" + std::to_string(named.size());
  }
}

void TableAssigner::NameFrames() {
  for (size_t i = input_.contents.images.size(); i-- > 0;) {
    const int sensor = assignment_.sensor_of_image[i];
    // The first image determines the name, because it comes last here.
    assignment_.frames[assignment_.frame_of_image[i]].name = NameWithoutSensor(
        input_.contents.images[i].name, assignment_.sensors[sensor].name);
  }
}

}  // namespace

bool IsCalledLikeCamera(std::string name) {
  name = ToLower(name);
  static constexpr auto kWords = {"cam",  "image", "left", "right",
                                  "lens", "front", "rear", "back"};
  return AnyOf(kWords, [&](const char* word) {
    return name.find(word) != std::string::npos;
  });
}

std::vector<std::string> SplitPath(const std::string& name) {
  std::vector<std::string> components(1);
  for (const char c : name) {
    if (c == '/') {
      components.emplace_back();
    } else {
      components.back() += c;
    }
  }
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
  Numbering<> sensor_numbers, frame_numbers;
  std::vector<int> sensors(num_images), frames(num_images);
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
  Numbering<> rigs, rig_sensors, rig_frames;
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

std::optional<RigAssignment> AssignByTables(const RigInput& input) {
  if (!input.contents.HasRigs()) return std::nullopt;
  return TableAssigner(input).Assign();
}

}  // namespace mgsfm
