// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/recording_cameras.h"

#include <algorithm>
#include <cctype>
#include <set>

#include "base/ranges.h"
#include "base/text_tools.h"
#include "calibration/calibration.h"
#include "calibration/lens_models.h"
#include "geometry/rigid_matrix.h"
#include "mgsfm/base/error.h"
#include "recordings/image_messages.h"
#include "rigs/rig_inference.h"

namespace mgsfm {
namespace {

// Folders have letters, digits, '_' and '-' only.
std::vector<std::string> TopicParts(std::string topic) {
  for (char& c : topic) {
    const bool is_kept = std::isalnum(static_cast<unsigned char>(c)) != 0 ||
                         c == '-' || c == '/';
    if (!is_kept) c = '_';
  }
  std::vector<std::string> parts = SplitPath(topic);
  EraseIf(&parts, [](const std::string& part) { return part.empty(); });
  return parts;
}

// "/left/image_raw/compressed": "/left/image_raw".
std::string RawTopicOf(const std::string& topic) {
  const std::string suffix = "/compressed";
  const bool has_suffix =
      topic.size() > suffix.size() &&
      topic.compare(topic.size() - suffix.size(), suffix.size(), suffix) == 0;
  return has_suffix ? topic.substr(0, topic.size() - suffix.size()) : topic;
}

std::string LastPart(const std::string& topic) {
  return topic.substr(topic.rfind('/') + 1);
}

// The topics of one camera differ in their last part: image_raw, image_rect.
std::string NamespaceOf(const std::string& topic) {
  std::string raw = RawTopicOf(topic);
  if (LastPart(raw).compare(0, 5, "image") != 0) return raw;
  const size_t slash = raw.rfind('/');
  return slash == std::string::npos || slash == 0 ? raw : raw.substr(0, slash);
}

std::string FolderOfParts(const std::vector<std::string>& parts,
                          size_t num_last) {
  if (parts.empty()) return "camera";
  const size_t begin = parts.size() - std::min(num_last, parts.size());
  return Joined(std::vector(parts.begin() + begin, parts.end()), "_");
}

// The shortest distinct ends of the namespaces, or else of the topics.
void NameFolders(const std::vector<RecordingTopic>& topics,
                 std::vector<RecordedCamera>* cameras) {
  for (const bool is_whole : {false, true}) {
    size_t num_parts = 1;  // of the longest name
    for (size_t num_last = 1; num_last <= num_parts; ++num_last) {
      std::set<std::string> folders;
      for (RecordedCamera& camera : *cameras) {
        const std::string& topic = topics[camera.topic_idx].name;
        const auto parts = TopicParts(is_whole ? topic : NamespaceOf(topic));
        num_parts = std::max(num_parts, parts.size());
        camera.folder = FolderOfParts(parts, num_last);
        folders.insert(camera.folder);
      }
      if (folders.size() == cameras->size()) return;
    }
  }
  throw Error(
      "image_topics: topics have names that make no distinct folders, "
      "such as '" +
      topics[cameras->front().topic_idx].name + "'; import them one by one");
}

bool IsDepth(const std::string& topic) {
  return ToLower(topic).find("depth") != std::string::npos;
}

// The raw topic of a camera is the best of its topics, and a message that is
// not compressed has the better pixels.
int TopicRank(const std::string& topic) {
  return (LastPart(RawTopicOf(topic)) == "image_raw" ? 0 : 2) +
         (RawTopicOf(topic) == topic ? 0 : 1);
}

std::vector<int> TopicsByDefault(const std::vector<RecordingTopic>& topics,
                                 const Context& context) {
  std::map<std::string, int> best;  // by namespace
  std::vector<std::string> left_out;
  for (size_t i = 0; i < topics.size(); ++i) {
    const RecordingTopic& topic = topics[i];
    if (!IsImageTopic(topic) || topic.num_messages == 0) continue;
    if (!topic.IsReadable() || IsDepth(topic.name)) {
      left_out.push_back(topic.name);
      continue;
    }
    const auto [entry, is_new] =
        best.emplace(NamespaceOf(topic.name), static_cast<int>(i));
    if (is_new) continue;
    const std::string& other = topics[entry->second].name;
    const bool is_better = TopicRank(topic.name) < TopicRank(other);
    left_out.push_back(is_better ? other : topic.name);
    if (is_better) entry->second = static_cast<int>(i);
  }
  if (!left_out.empty()) {
    context.Info("left out: " + Joined(left_out, ", ") +
                 " (depth, or other topics of the same cameras); image_topics "
                 "selects topics");
  }
  std::vector<int> chosen;
  for (const auto& [name, topic_idx] : best) chosen.push_back(topic_idx);
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

std::vector<int> TopicsOfList(const Recording& recording,
                              const std::vector<std::string>& names) {
  const std::vector<RecordingTopic>& topics = recording.topics();
  std::vector<int> chosen;
  for (const std::string& name : names) {
    const auto found = std::find_if(
        topics.begin(), topics.end(),
        [&](const RecordingTopic& topic) { return topic.name == name; });
    const std::string subject =
        "topic '" + name + "' (image_topics) of recording " + recording.Name();
    if (found == topics.end()) {
      throw Error(subject +
                  " does not exist; run recording_importer without output_path "
                  "to list the topics");
    }
    if (!IsImageTopic(*found)) {
      throw Error(subject + " has messages of " + found->type +
                  "; choose topics of sensor_msgs/Image or CompressedImage");
    }
    if (!found->IsReadable()) {
      throw Error(subject + " has messages in the encoding '" +
                  found->encoding + "'; convert it to cdr or ros1");
    }
    const auto idx = static_cast<int>(found - topics.begin());
    if (Contains(chosen, idx)) {
      throw Error(subject + " is listed twice; list it once");
    }
    chosen.push_back(idx);
  }
  return chosen;
}

// As image_transport: beside the topic of images.
int InfoTopicOf(const std::string& image_topic,
                const std::vector<RecordingTopic>& topics) {
  const std::string raw = RawTopicOf(image_topic);
  const std::string name = raw.substr(0, raw.rfind('/') + 1) + "camera_info";
  for (size_t i = 0; i < topics.size(); ++i) {
    if (topics[i].name == name && topics[i].type == "sensor_msgs/CameraInfo" &&
        topics[i].IsReadable()) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

// The lens of the images: of rectified ones, that of the projection matrix.
CalibratedCamera LensOf(const RecordedCamera& camera) {
  const CameraInfoMessage& info = *camera.info;
  PinholeLens lens{
      info.K[0], info.K[4], info.K[2], info.K[5], info.distortion_model,
      info.D};
  if (camera.is_rectified) {
    lens = {info.P[0], info.P[5], info.P[2], info.P[6], "none", {}};
  }
  const double bin_x = std::max(1u, info.binning[0]);
  const double bin_y = std::max(1u, info.binning[1]);
  lens.fx /= bin_x;
  lens.fy /= bin_y;
  // The center of the first pixel is 0.
  lens.cx = (lens.cx - info.crop_px[0] + 0.5) / bin_x - 0.5;
  lens.cy = (lens.cy - info.crop_px[1] + 0.5) / bin_y - 0.5;
  CalibratedCamera calibrated;
  SetLens(lens, &calibrated);
  return calibrated;
}

// Why the intrinsics do not belong to the images; empty if they do.
std::string WhyOtherSize(const RecordedCamera& camera) {
  const CameraInfoMessage& info = *camera.info;
  const bool is_cropped = info.crop_px[2] > 0 && info.crop_px[3] > 0;
  const int64_t width = (is_cropped ? info.crop_px[3] : info.width_px) /
                        std::max(1u, info.binning[0]);
  const int64_t height = (is_cropped ? info.crop_px[2] : info.height_px) /
                         std::max(1u, info.binning[1]);
  if (width == camera.size_px.width && height == camera.size_px.height) {
    return "";
  }
  return "is for images of " + SizeText(width, height) + " px, but they have " +
         SizeText(camera.size_px.width, camera.size_px.height) + " px";
}

void SetIntrinsics(const RecordedCamera& camera, const std::string& topic,
                   const Context& context, RigConfigCamera* config) {
  // Drivers of cameras without calibration send zeros.
  const double focal_length =
      camera.is_rectified ? camera.info->P[0] : camera.info->K[0];
  if (focal_length == 0.0) {
    context.Info("topic '" + topic + "' has no calibration");
    return;
  }
  const CalibratedCamera calibrated = LensOf(camera);
  const std::string size_problem = WhyOtherSize(camera);
  const std::string problem =
      size_problem.empty() ? calibrated.why_no_model : size_problem;
  if (!problem.empty()) {
    context.Warning("topic '" + topic + "' " + problem +
                    "; the intrinsics of '" + camera.folder + "' are left out");
    return;
  }
  config->camera_model = calibrated.model;
  config->camera_params = calibrated.params;
}

// nullopt if it is unknown.
std::optional<Rigid3> CamFromReference(const RecordedCamera& camera,
                                       const RecordedCamera& reference,
                                       const FrameTree& frames,
                                       const Context& context) {
  if (frames.IsEmpty()) return std::nullopt;
  if (camera.frame_id == reference.frame_id) {
    context.Warning("the cameras '" + reference.folder + "' and '" +
                    camera.folder + "' have the same frame '" +
                    camera.frame_id + "'; the pose of '" + camera.folder +
                    "' in the rig is left out");
    return std::nullopt;
  }
  const auto between = frames.Between(camera.frame_id, reference.frame_id);
  const auto image = ImageFromFrame(camera);
  const auto reference_image = ImageFromFrame(reference);
  if (!between || !image || !reference_image) {
    const std::string why =
        between ? "the CameraInfo of '" + (image ? reference : camera).folder +
                      "' has an R that is no rotation"
                : "/tf_static does not connect the frames '" + camera.frame_id +
                      "' and '" + reference.frame_id + "'";
    context.Warning(why + "; the pose of '" + camera.folder +
                    "' in the rig is left out");
    return std::nullopt;
  }
  return *image * *between * reference_image->Inverse();
}

}  // namespace

std::vector<RecordedCamera> ChooseCameras(const Recording& recording,
                                          const std::string& image_topics,
                                          const Context& context) {
  const std::vector<RecordingTopic>& topics = recording.topics();
  const std::vector<std::string> names = SplitList(image_topics);
  const std::vector<int> chosen = names.empty()
                                      ? TopicsByDefault(topics, context)
                                      : TopicsOfList(recording, names);
  if (chosen.empty()) {
    throw Error("recording " + recording.Name() +
                " has no topic of images; run recording_importer without "
                "output_path to list the topics");
  }
  std::vector<RecordedCamera> cameras;
  for (const int topic_idx : chosen) {
    RecordedCamera camera;
    camera.topic_idx = topic_idx;
    camera.info_topic_idx = InfoTopicOf(topics[topic_idx].name, topics);
    camera.is_rectified = LastPart(RawTopicOf(topics[topic_idx].name))
                              .compare(0, 10, "image_rect") == 0;
    cameras.push_back(std::move(camera));
  }
  NameFolders(topics, &cameras);
  return cameras;
}

std::optional<Rigid3> ImageFromFrame(const RecordedCamera& camera) {
  if (!camera.is_rectified || !camera.info) return Rigid3();
  return RigidFromRotation(camera.info->R.data());
}

std::optional<RigConfig> MakeRecordedRig(
    const std::vector<RecordedCamera>& cameras, const FrameTree& frames,
    const std::vector<RecordingTopic>& topics, const Context& context) {
  RigConfig rig;
  size_t num_lenses = 0, num_poses = 0;
  for (const RecordedCamera& camera : cameras) {
    RigConfigCamera config;
    config.image_prefix = camera.folder + "/";
    config.is_reference = rig.cameras.empty();
    if (camera.info) {
      SetIntrinsics(camera, topics[camera.info_topic_idx].name, context,
                    &config);
    }
    config.cam_from_rig =
        config.is_reference
            ? std::make_optional(Rigid3())
            : CamFromReference(camera, cameras.front(), frames, context);
    num_lenses += config.camera_model ? 1 : 0;
    num_poses += config.cam_from_rig && !config.is_reference ? 1 : 0;
    rig.cameras.push_back(std::move(config));
  }
  if (cameras.size() == 1 && num_lenses == 0) return std::nullopt;
  context.Info("rig: intrinsics of " + std::to_string(num_lenses) + " of " +
               std::to_string(cameras.size()) + " cameras by CameraInfo, " +
               std::to_string(num_poses) + " of " +
               std::to_string(cameras.size() - 1) +
               " poses in the rig by /tf_static");
  return rig;
}

}  // namespace mgsfm
