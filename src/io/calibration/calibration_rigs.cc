// SPDX-License-Identifier: BSD-3-Clause
#include "calibration/calibration_rigs.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>
#include <utility>

#include "base/file_reading.h"
#include "base/format.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "calibration/calibration.h"
#include "calibration/yaml_value.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Cameras with a common trigger agree within this difference.
constexpr double kMaxTriggerDifference_s = 1e-3;

// The start of image names that may belong to a camera.
struct Prefix {
  std::string outer;  // folders before it, "seq1/"
  std::string name;   // "cam0"
  std::string text;   // "seq1/cam0/"
  std::vector<int> images;
};

// All folders, and starts of file names up to their last '_' or '-'.
std::map<std::string, Prefix> FindPrefixes(const RigInput& input) {
  std::map<std::string, Prefix> prefixes;
  for (size_t i = 0; i < input.contents.images.size(); ++i) {
    const std::string& image_name = input.contents.images[i].name;
    std::string outer;
    const auto add = [&](const std::string& name, char separator) {
      const std::string text = outer + name + separator;
      Prefix& prefix =
          prefixes.emplace(text, Prefix{outer, name, text, {}}).first->second;
      prefix.images.push_back(static_cast<int>(i));
    };
    const std::vector<std::string> parts = SplitPath(image_name);
    for (size_t k = 0; k + 1 < parts.size(); ++k) {
      add(parts[k], '/');
      outer += parts[k] + "/";
    }
    const size_t end = parts.back().find_last_of("_-");
    if (end != std::string::npos) {
      add(parts.back().substr(0, end), parts.back()[end]);
    }
  }
  return prefixes;
}

class CameraMatcher {
 public:
  CameraMatcher(const RigInput& input,
                const std::vector<CalibratedCamera>& cameras)
      : input_(input),
        cameras_(cameras),
        prefixes_(FindPrefixes(input)),
        camera_of_image_(input.contents.images.size(), -1),
        prefixes_of_camera_(cameras.size()) {}

  void Match() {
    size_t num_rounds = 0;
    for (const CalibratedCamera& camera : cameras_) {
      num_rounds = std::max(num_rounds, camera.names.size());
    }
    for (size_t round = 0; round < num_rounds; ++round) {
      MatchWith([&](const CalibratedCamera& camera, const Prefix& prefix) {
        return round < camera.names.size() &&
               ToLower(camera.names[round]) == ToLower(prefix.name);
      });
    }
    MatchWith([](const CalibratedCamera& camera, const Prefix& prefix) {
      const auto number = NumberAtEnd(camera.names.back());
      return number && prefix.text.back() == '/' &&
             NumberAtEnd(prefix.name) == number;
    });
  }

  bool HasMatches() const {
    return AnyOf(camera_of_image_, [](int camera) { return camera >= 0; });
  }
  // -1 for none.
  int CameraOf(size_t image) const { return camera_of_image_[image]; }
  const std::vector<const Prefix*>& PrefixesOf(size_t camera) const {
    return prefixes_of_camera_[camera];
  }
  std::vector<int> UnmatchedImages() const {
    std::vector<int> images;
    for (size_t i = 0; i < camera_of_image_.size(); ++i) {
      if (camera_of_image_[i] < 0) images.push_back(static_cast<int>(i));
    }
    return images;
  }
  // The folders of the images, for messages.
  std::string FolderNames() const {
    std::set<std::string> names;
    for (const auto& [text, prefix] : prefixes_) {
      if (text.back() == '/') names.insert("'" + text + "'");
    }
    return " " + (names.empty() ? "none" : Joined(names, " "));
  }

 private:
  // Skips matched cameras and images.
  template <class Predicate>
  void MatchWith(const Predicate& fits) {
    std::vector<std::pair<int, const Prefix*>> found;
    for (size_t c = 0; c < cameras_.size(); ++c) {
      if (!prefixes_of_camera_[c].empty()) continue;
      for (const auto& [text, prefix] : prefixes_) {
        const bool is_free = NoneOf(prefix.images, [this](int image) {
          return camera_of_image_[image] >= 0;
        });
        if (is_free && fits(cameras_[c], prefix)) {
          found.emplace_back(static_cast<int>(c), &prefix);
        }
      }
    }
    for (const auto& [camera, prefix] : found) Take(camera, *prefix);
  }
  void Take(int camera, const Prefix& prefix) {
    for (const int image : prefix.images) {
      int& known = camera_of_image_[image];
      if (known >= 0) {
        throw Error("image '" + input_.contents.images[image].name +
                    "' fits the cameras '" + cameras_[known].names.front() +
                    "' (" + cameras_[known].place + ") and '" +
                    cameras_[camera].names.front() + "' (" +
                    cameras_[camera].place +
                    "); rename the folders of images like the cameras");
      }
      known = camera;
    }
    prefixes_of_camera_[camera].push_back(&prefix);
  }

  const RigInput& input_;
  const std::vector<CalibratedCamera>& cameras_;
  const std::map<std::string, Prefix> prefixes_;
  std::vector<int> camera_of_image_;
  std::vector<std::vector<const Prefix*>> prefixes_of_camera_;
};

// The intrinsics scaled to images of another size. The aspect ratio must equal
// that of the calibration, up to the rounding of one pixel.
std::vector<double> ScaledParams(const CalibratedCamera& camera,
                                 const Camera& of_images) {
  std::vector<double> params = camera.params;
  if (!camera.size_px) return params;
  const auto [width, height] = *camera.size_px;
  const double scale = static_cast<double>(of_images.width_px) / width;
  if (std::abs(scale * height - of_images.height_px) > 1.0) {
    const auto size = [](int w, int h) {
      return std::to_string(w) + "x" + std::to_string(h);
    };
    throw Error(camera.place + ": camera '" + camera.names.front() +
                "' was calibrated with images of " + size(width, height) +
                " px, but its images have " +
                size(of_images.width_px, of_images.height_px) +
                " px; calibrate it with images as they are used");
  }
  const CameraModelInfo& info = InfoOf(*camera.model);
  for (const int i : info.focal_length_idxs) params[i] *= scale;
  for (const int i : info.principal_point_idxs) params[i] *= scale;
  return params;
}

void CheckHasModel(const CalibratedCamera& camera, const std::string& images) {
  if (camera.why_no_model.empty()) return;
  throw Error(camera.place + ": camera '" + camera.names.front() +
              "' of the images in '" + images + "' " + camera.why_no_model);
}

RigConfigCamera MakeConfig(const RigInput& input,
                           const CalibratedCamera& camera,
                           const Prefix& prefix) {
  CheckHasModel(camera, prefix.text);
  RigConfigCamera config;
  config.image_prefix = prefix.text;
  if (!camera.model) return config;
  config.camera_model = camera.model;
  config.camera_params =
      ScaledParams(camera, input.CameraOf(prefix.images.front()));
  return config;
}

// Makes a rig for each outer folder. The reference is the first camera with a
// pose, so that no known pose is lost, or else the first camera.
std::vector<RigConfig> MakeRigs(const RigInput& input,
                                const std::vector<CalibratedCamera>& cameras,
                                const CameraMatcher& matcher) {
  struct OuterRig {
    RigConfig rig;
    std::vector<const CalibratedCamera*> cameras;
  };
  std::map<std::string, OuterRig> rigs;
  for (size_t c = 0; c < cameras.size(); ++c) {
    for (const Prefix* prefix : matcher.PrefixesOf(c)) {
      OuterRig& outer = rigs[prefix->outer];
      outer.cameras.push_back(&cameras[c]);
      outer.rig.cameras.push_back(MakeConfig(input, cameras[c], *prefix));
    }
  }
  std::vector<RigConfig> configs;
  for (auto& [folder, outer] : rigs) {
    const auto placed = std::find_if(
        outer.cameras.begin(), outer.cameras.end(),
        [](const auto* camera) { return camera->cam_from_base.has_value(); });
    const size_t ref =
        placed == outer.cameras.end() ? 0 : placed - outer.cameras.begin();
    for (size_t i = 0; i < outer.cameras.size(); ++i) {
      RigConfigCamera& config = outer.rig.cameras[i];
      config.is_reference = i == ref;
      if (i == ref) {
        config.cam_from_rig = Rigid3();
      } else if (outer.cameras[i]->cam_from_base) {
        config.cam_from_rig = *outer.cameras[i]->cam_from_base *
                              outer.cameras[ref]->cam_from_base->Inverse();
      }
    }
    configs.push_back(std::move(outer.rig));
  }
  return configs;
}

// Warns of images that were not taken at the times of their names or time
// stamps.
void WarnOfTimeShifts(const std::vector<CalibratedCamera>& cameras,
                      const CameraMatcher& matcher, const Context& context) {
  const CalibratedCamera* first = nullptr;
  for (size_t c = 0; c < cameras.size(); ++c) {
    const CalibratedCamera& camera = cameras[c];
    if (matcher.PrefixesOf(c).empty() || !camera.time_shift_s) continue;
    if (first == nullptr) first = &camera;
    const double late_s = *camera.time_shift_s - *first->time_shift_s;
    if (std::abs(late_s) <= kMaxTriggerDifference_s) continue;
    const std::string text = Formatted(
        "' is %.4g s %s relative to camera '%s' by "
        "timeshift_cam_imu; set SoftRig.method time_offset and "
        "image_timestamps_path",
        std::abs(late_s), late_s > 0.0 ? "late" : "early",
        first->names.back().c_str());
    context.Warning(camera.place + ": camera '" + camera.names.back() + text);
  }
}

void Report(const RigInput& input, const std::vector<CalibratedCamera>& cameras,
            const CameraMatcher& matcher, const Context& context) {
  for (size_t c = 0; c < cameras.size(); ++c) {
    const CalibratedCamera& camera = cameras[c];
    std::string line = "calibration: camera '" + camera.names.front() + "'";
    if (matcher.PrefixesOf(c).empty()) {
      context.Info(line + " has no images");
      continue;
    }
    line += " is that of";
    for (const Prefix* prefix : matcher.PrefixesOf(c)) {
      line += " '" + prefix->text + "' (" +
              std::to_string(prefix->images.size()) + " images)";
    }
    line += ", ";
    line += camera.model ? InfoOf(*camera.model).name
                         : std::string_view("intrinsics of its images");
    if (camera.fit_error_px) {
      line += Formatted(" within %.2f px", *camera.fit_error_px);
    }
    context.Info(line + (camera.cam_from_base ? ", pose known"
                                              : ", pose to be estimated"));
  }
  const std::vector<int> unmatched = matcher.UnmatchedImages();
  if (unmatched.empty()) return;
  context.Warning(std::to_string(unmatched.size()) +
                  " images belong to no camera of the calibration and are "
                  "single; the first is '" +
                  input.contents.images[unmatched.front()].name + "'");
}

bool IsRigConfig(const std::string& path) {
  if (std::filesystem::path(path).extension() != ".json") return false;
  const YamlValue file(path, ReadFile(path));
  if (!file.IsSequence()) return false;
  const auto items = file.Items();
  return !items.empty() && items.front().second.Has("cameras");
}

// An image of an instance of OpenSfM.
struct InstanceImage {
  int camera = -1;    // -1: none
  std::string frame;  // its first image
};

// The images of all instances, by name. Instances are arrays of pairs [image,
// rig camera], in an object or an array, and become frames called like their
// first image.
std::map<std::string, InstanceImage> ReadInstances(
    const fs::path& path, const std::vector<CalibratedCamera>& cameras) {
  std::map<std::string, int> camera_of_name;
  for (size_t c = 0; c < cameras.size(); ++c) {
    camera_of_name[cameras[c].names.front()] = static_cast<int>(c);
  }
  std::map<std::string, InstanceImage> images;
  const YamlValue file(path.string(), ReadFile(path));
  for (const auto& [id, instance] : file.Items()) {
    std::string frame;
    for (const auto& [key, pair] : instance.Items()) {
      const auto texts = pair.Items();
      if (texts.size() != 2) pair.Throw("is no pair [image, rig camera]");
      const std::string name = texts[0].second.Text();
      const auto camera = camera_of_name.find(texts[1].second.Text());
      if (camera == camera_of_name.end()) {
        texts[1].second.Throw(
            "is no camera of rig_cameras.json; correct one of the files");
      }
      if (frame.empty()) frame = name;
      if (!images.emplace(name, InstanceImage{camera->second, frame}).second) {
        texts[0].second.Throw("is in two instances; delete one of them");
      }
    }
  }
  return images;
}

// A sensor with the pose relative to the base, and with the intrinsics.
RigAssignment::Sensor MakeSensor(const CalibratedCamera& camera,
                                 const RigInput& input, size_t image) {
  CheckHasModel(camera, input.contents.images[image].name);
  RigAssignment::Sensor sensor;
  sensor.name = camera.names.front();
  sensor.sensor_from_rig = camera.cam_from_base;
  if (!camera.model) return sensor;
  sensor.camera_model = camera.model;
  sensor.camera_params =
      ScaledParams(camera, input.CameraOf(static_cast<int>(image)));
  return sensor;
}

}  // namespace

std::optional<RigAssignment> AssignByInstances(const RigInput& input,
                                               const std::string& path,
                                               const Context& context) {
  std::vector<fs::path> files = CalibrationFiles(path);
  EraseIf(&files, [](const fs::path& file) {
    return file.filename() != "rig_cameras.json" ||
           !fs::exists(file.parent_path() / "rig_assignments.json");
  });
  if (files.size() != 1) return std::nullopt;
  const fs::path file = files[0].parent_path() / "rig_assignments.json";
  const auto cameras = ReadCalibration(files[0]);
  const auto listed = ReadInstances(file, cameras);
  const auto num_listed = CountIf(
      input.contents.images,
      [&](const ImageRow& image) { return listed.count(image.name) > 0; });
  if (num_listed == 0) {
    context.Warning("'" + file.string() +
                    "' names none of the images and is not used; give names "
                    "relative to image_path");
    return std::nullopt;
  }
  const size_t num_images = input.contents.images.size();
  context.Info("frames of " + std::to_string(num_listed) + " of " +
               std::to_string(num_images) + " images by '" + file.string() +
               "'; others are single");
  CameraMatcher matcher(input, cameras);
  if (static_cast<size_t>(num_listed) < num_images) matcher.Match();
  RigAssignment assignment;
  assignment.source = "'" + file.string() + "'";
  assignment.rig_ids.resize(1);
  assignment.sensor_of_image.resize(num_images);
  assignment.frame_of_image.resize(num_images);
  Numbering<int> sensors;
  Numbering<> frames;
  std::vector<int> single_images;
  for (size_t i = 0; i < num_images; ++i) {
    const std::string& name = input.contents.images[i].name;
    const auto found = listed.find(name);
    const auto [camera, frame] = found == listed.end()
                                     ? InstanceImage{matcher.CameraOf(i), name}
                                     : found->second;
    if (camera < 0) {
      single_images.push_back(static_cast<int>(i));
      continue;
    }
    assignment.sensor_of_image[i] = sensors(camera);
    if (sensors.size() > assignment.sensors.size()) {
      assignment.sensors.push_back(MakeSensor(cameras[camera], input, i));
    }
    assignment.frame_of_image[i] = frames(frame);
    assignment.frames.resize(frames.size());
    assignment.frames[frames(frame)].name = WithoutExtension(frame);
  }
  AssignSingleImages(input, single_images, &assignment);
  return assignment;
}

std::optional<int> NumberAtEnd(const std::string& name) {
  const size_t begin = name.find_last_not_of("0123456789") + 1;
  const std::string digits = name.substr(begin);
  if (digits.empty() || digits.size() > 3) return std::nullopt;
  return std::stoi(digits);
}

std::vector<RigConfig> ReadCalibrationRigs(const RigInput& input,
                                           const std::string& paths,
                                           const Context& context) {
  if (IsRigConfig(paths)) return ReadRigConfig(paths);
  const std::vector<CalibratedCamera> cameras = ReadCalibration(paths);
  CameraMatcher matcher(input, cameras);
  matcher.Match();
  if (!matcher.HasMatches()) {
    std::string names;
    for (const CalibratedCamera& camera : cameras) {
      names += " '" + camera.names.front() + "'";
    }
    throw Error("calibration '" + paths + "': no images belong to its cameras" +
                names + "; the folders of images are" + matcher.FolderNames() +
                "; rename them like the cameras");
  }
  std::vector<RigConfig> rigs = MakeRigs(input, cameras, matcher);
  Report(input, cameras, matcher, context);
  WarnOfTimeShifts(cameras, matcher, context);
  return rigs;
}

}  // namespace mgsfm
