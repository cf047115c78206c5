// SPDX-License-Identifier: BSD-3-Clause
#include "evaluation/true_trajectory.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "base/format.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"
#include "mgsfm/models/trajectory_io.h"
#include "models/model_checks.h"
#include "rigs/image_times.h"

namespace mgsfm {
namespace {

void KeepPrefix(const std::string& path, const std::string& prefix,
                PoseModel* poses) {
  auto& images = poses->images;
  EraseIf(&images, [&](const ModelImage& image) {
    return image.name.compare(0, prefix.size(), prefix) != 0;
  });
  if (images.empty()) {
    throw Error("no image of the model '" + path +
                "' has a name that starts with '" + prefix + "'");
  }
}

// The model as rows of a database, with placeholder intrinsics.
DatabaseContents ToContents(const PoseModel& poses, const std::string& path) {
  DatabaseContents contents;
  contents.path = path;
  std::set<CameraId> camera_ids;
  for (const ModelImage& image : poses.images) {
    contents.images.push_back({image.id, image.name, image.camera_id, {}});
    camera_ids.insert(image.camera_id);
  }
  for (const CameraId id : camera_ids) {
    contents.cameras.push_back(
        {id, CameraModelId::kSimplePinhole, 1, 1, {1.0, 0.5, 0.5}, false});
  }
  AddModelTables(poses, &contents);
  return contents;
}

void ChangeReference(int sensor_idx, Scene* scene) {
  Rig& rig = scene->rigs[scene->sensors[sensor_idx].rig_idx];
  const std::optional<Rigid3> new_from_old =
      scene->sensors[sensor_idx].sensor_from_rig;
  rig.ref_sensor_idx = sensor_idx;
  for (const int other : rig.sensor_idxs) {
    std::optional<Rigid3>& pose = scene->sensors[other].sensor_from_rig;
    if (!new_from_old) {
      pose.reset();
    } else if (pose) {
      pose = *pose * new_from_old->Inverse();
    }
  }
  scene->sensors[sensor_idx].sensor_from_rig = Rigid3();
}

}  // namespace

std::optional<int> PosedScene::FindSensor(const std::string& folder) const {
  const auto found = sensor_of_folder.find(folder);
  if (found != sensor_of_folder.end()) return found->second;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (scene.sensors[i].name == folder) return static_cast<int>(i);
  }
  return std::nullopt;
}

PosedScene ReadPosedScene(const std::string& path,
                          const std::string& image_prefix,
                          const std::string& reference,
                          const std::string& rig_name_rule) {
  PoseModel poses = ReadModelPoses(path);
  SceneLoadingOptions naming;
  naming.rig_name_rule = rig_name_rule;
  if (rig_name_rule == "auto") CheckModelTables(poses, path);
  KeepPrefix(path, image_prefix, &poses);
  PosedScene model;
  model.scene = LoadScene(ToContents(poses, path), naming, Context()).scene;
  // Scene and model are both sorted by name.
  model.cam_from_world = Transformed(poses.images, &ModelImage::cam_from_world);
  for (const Image& image : model.scene.images) {
    model.sensor_of_folder.emplace(FolderOfName(image.name), image.sensor_idx);
  }
  if (reference.empty()) return model;
  const std::optional<int> sensor_idx = model.FindSensor(reference);
  if (!sensor_idx) {
    throw Error("no image of the model '" + path + "' is in the folder '" +
                reference + "' that --reference names");
  }
  ChangeReference(*sensor_idx, &model.scene);
  return model;
}

std::optional<double> ParseNumber(const std::string& text) {
  if (text.empty() ||
      text.find_first_not_of("0123456789.") != std::string::npos) {
    return std::nullopt;
  }
  return ParseDouble(text);
}

namespace {

// True poses of the reference sensor, and which of them belongs to each frame;
// frames are known by the names of their images without folder and extension.
struct TrueTrajectory {
  std::vector<Rigid3> ref_from_world;
  std::map<std::string, size_t> pose_of_frame;
};

// An image and the pose of the trajectory that it belongs to.
using PlacedImage = std::pair<size_t, ImagePoses>;

// The rig with the most images.
const Rig& LargestRig(const Scene& scene) {
  std::vector<int> num_images(scene.rigs.size(), 0);
  for (const Image& image : scene.images) {
    ++num_images[scene.sensors[image.sensor_idx].rig_idx];
  }
  const auto most = std::max_element(num_images.begin(), num_images.end());
  return scene.rigs[most - num_images.begin()];
}

// The poses of the trajectory at the median step of the images between them.
std::vector<size_t> PosesInGaps(const std::vector<PlacedImage>& images) {
  std::vector<size_t> poses = Transformed(images, &PlacedImage::first);
  SortUnique(&poses);
  std::vector<size_t> steps;
  for (size_t i = 1; i < poses.size(); ++i) {
    steps.push_back(poses[i] - poses[i - 1]);
  }
  if (steps.empty()) return {};
  std::vector<size_t> sorted = steps;
  std::sort(sorted.begin(), sorted.end());
  const auto median = static_cast<double>(sorted[sorted.size() / 2]);
  std::vector<size_t> in_gaps;
  for (size_t i = 0; i < steps.size(); ++i) {
    const auto num_steps = static_cast<size_t>(std::lround(steps[i] / median));
    for (size_t k = 1; k < num_steps; ++k) {
      in_gaps.push_back(poses[i] + k * steps[i] / num_steps);
    }
  }
  return in_gaps;
}

// Assigns poses to frames by line number (from 0), if the names of frames are
// numbers; else in order, if there are equally many. Errors name `path`.
TrueTrajectory AssignByNumber(const std::vector<std::string>& frames,
                              std::vector<Rigid3> ref_from_world,
                              const std::string& path) {
  const size_t num_poses = ref_from_world.size();
  bool are_line_numbers = true;
  for (const std::string& frame : frames) {
    const auto number = ParseNumber(frame);
    are_line_numbers &= number && *number < static_cast<double>(num_poses) &&
                        *number == std::floor(*number);
  }
  if (!are_line_numbers && frames.size() != num_poses) {
    throw Error(
        Formatted("'%s' has %zu poses for the %zu frames of the model, whose "
                  "names are not line numbers",
                  path.c_str(), num_poses, frames.size()));
  }
  TrueTrajectory trajectory{std::move(ref_from_world), {}};
  for (size_t i = 0; i < frames.size(); ++i) {
    trajectory.pose_of_frame[frames[i]] =
        are_line_numbers ? static_cast<size_t>(*ParseNumber(frames[i])) : i;
  }
  return trajectory;
}

bool MayBeCounter(const std::string& frame) {
  constexpr size_t kMaxCounterDigits = 9;  // UNIX times in s have ten
  return frame.size() <= kMaxCounterDigits &&
         frame.find('.') == std::string::npos;
}

// The nearest frame of each pose, and its distance in time.
std::map<size_t, std::pair<double, std::string>> NearestFrames(
    const std::vector<std::string>& frames, const std::vector<TimedPose>& poses,
    double max_difference_s) {
  std::map<size_t, std::pair<double, std::string>> frame_of_pose;
  for (const std::string& frame : frames) {
    const double time_s =
        1e-9 * static_cast<double>(*TimeOrNumberInStem(frame));
    size_t nearest = 0;
    for (size_t i = 1; i < poses.size(); ++i) {
      if (std::abs(poses[i].timestamp_s - time_s) <
          std::abs(poses[nearest].timestamp_s - time_s)) {
        nearest = i;
      }
    }
    const double difference_s = std::abs(poses[nearest].timestamp_s - time_s);
    if (difference_s > max_difference_s) continue;
    const auto [entry, is_new] =
        frame_of_pose.emplace(nearest, std::pair(difference_s, frame));
    if (!is_new && difference_s < entry->second.first) {
      entry->second = {difference_s, frame};
    }
  }
  return frame_of_pose;
}

// Assigns poses to frames by the times in their names (TimeOrNumberInStem),
// within half the mean step between poses, the nearest frame to each pose; else
// in order.
// Throws Error if no frame is near a pose, or if names may be both counters and
// times.
TrueTrajectory AssignByTime(const std::vector<std::string>& frames,
                            const std::vector<TimedPose>& poses,
                            const std::string& path) {
  std::vector<Rigid3> ref_from_world =
      Transformed(poses, &TimedPose::cam_from_world);
  const bool have_times =
      poses.size() > 1 && AllOf(frames, [](const std::string& frame) {
        return TimeOrNumberInStem(frame).has_value();
      });
  if (!have_times) {
    return AssignByNumber(frames, std::move(ref_from_world), path);
  }
  const double max_difference_s =
      0.5 * (poses.back().timestamp_s - poses.front().timestamp_s) /
      static_cast<double>(poses.size() - 1);
  const auto frame_of_pose = NearestFrames(frames, poses, max_difference_s);
  if (frame_of_pose.empty()) {
    throw Error("no time in '" + path +
                "' is near that of any image name; give both by one clock");
  }
  const bool is_ambiguous = AllOf(frames, MayBeCounter) &&
                            frames.size() == poses.size() &&
                            frame_of_pose.size() < frames.size();
  if (is_ambiguous) {
    throw Error("the names of frames, such as '" + frames.back() +
                "', may be times in s or count the " +
                std::to_string(poses.size()) + " poses of '" + path +
                "'; name images by times with decimals, or give the poses in "
                "the format kitti");
  }
  TrueTrajectory trajectory{std::move(ref_from_world), {}};
  for (const auto& [pose, frame] : frame_of_pose) {
    trajectory.pose_of_frame[frame.second] = pose;
  }
  return trajectory;
}

// Sorted names of all frames of the model, and of frames of other images in the
// folders of its sensors. Throws Error if two frames of the model have the same
// name, as in two sequences.
std::vector<std::string> FrameNames(const PosedScene& model,
                                    const ImageNames& other_images) {
  std::map<std::string, int> frame_of_name;
  for (const Image& image : model.scene.images) {
    const auto [other, is_new] =
        frame_of_name.emplace(StemOfName(image.name), image.frame_idx);
    if (is_new || other->second == image.frame_idx) continue;
    throw Error("image '" + image.name +
                "' is called like one of another frame, '" +
                model.scene.frames[other->second].name +
                "'; choose the sequence of the true poses with --image_prefix");
  }
  for (const std::string& name :
       other_images.value_or(std::vector<std::string>())) {
    if (model.FindSensor(FolderOfName(name))) {
      frame_of_name.emplace(StemOfName(name), -1);
    }
  }
  return Transformed(frame_of_name,
                     [](const auto& frame) { return frame.first; });
}

}  // namespace

std::vector<ImagePoses> PairWithTrajectory(
    const PosedScene& model, const std::string& gt_path, TruthFormat format,
    const std::vector<std::optional<Rigid3>>& sensor_from_ref,
    const ImageNames& other_images) {
  const std::vector<std::string> frames = FrameNames(model, other_images);
  const TrueTrajectory trajectory =
      format == TruthFormat::kKitti
          ? AssignByNumber(frames, ReadKittiPoses(gt_path), gt_path)
          : AssignByTime(frames, ReadTumPoses(gt_path), gt_path);
  std::vector<PlacedImage> images;
  const auto add_at = [&](size_t pose, const std::string& name, int sensor_idx,
                          const std::optional<Rigid3>& cam_from_model) {
    if (!sensor_from_ref[sensor_idx]) return;
    images.push_back(
        {pose,
         {name, model.scene.IsReference(sensor_idx), cam_from_model,
          *sensor_from_ref[sensor_idx] * trajectory.ref_from_world[pose]}});
  };
  const auto add = [&](const std::string& name, int sensor_idx,
                       const std::optional<Rigid3>& cam_from_model) {
    const auto pose = trajectory.pose_of_frame.find(StemOfName(name));
    if (pose == trajectory.pose_of_frame.end()) return;
    add_at(pose->second, name, sensor_idx, cam_from_model);
  };
  for (size_t i = 0; i < model.scene.images.size(); ++i) {
    const Image& image = model.scene.images[i];
    add(image.name, image.sensor_idx, model.cam_from_world[i]);
  }
  if (other_images) {
    for (const std::string& name : *other_images) {
      const auto sensor_idx = model.FindSensor(FolderOfName(name));
      if (sensor_idx) add(name, *sensor_idx, std::nullopt);
    }
  } else if (!images.empty()) {
    const Rig& rig = LargestRig(model.scene);
    for (const size_t pose : PosesInGaps(images)) {
      for (const int sensor_idx : rig.sensor_idxs) {
        add_at(pose, "", sensor_idx, std::nullopt);
      }
    }
  }
  StableSortBy(&images, &PlacedImage::first);
  return Transformed(images, &PlacedImage::second);
}

}  // namespace mgsfm
