// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/recorded_positions.h"

#include <charconv>
#include <optional>
#include <utility>

#include "base/format.h"
#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr const char* kTransforms = "tf2_msgs/TFMessage";

TopicChoice ChoiceOf(const RecordingImportOptions& options) {
  return {"position_topic",
          options.position_topic,
          "positions",
          {"sensor_msgs/NavSatFix", "nav_msgs/Odometry"},
          {kTransforms}};
}

}  // namespace

std::string TimeText(int64_t time_ns) {
  return Formatted("%06lld.%09lld",
                   static_cast<long long>(time_ns / kNsPerSecond),
                   static_cast<long long>(time_ns % kNsPerSecond));
}

int FindTopic(const Recording& recording, const TopicChoice& choice,
              const Context& context) {
  if (choice.wanted == "none") return -1;
  const std::vector<RecordingTopic>& topics = recording.topics();
  if (choice.wanted != "auto") {
    for (size_t i = 0; i < topics.size(); ++i) {
      const bool has_type = Contains(choice.automatic_types, topics[i].type) ||
                            Contains(choice.other_types, topics[i].type);
      if (topics[i].name == choice.wanted && has_type) {
        return static_cast<int>(i);
      }
    }
    std::vector<std::string> types = choice.automatic_types;
    types.insert(types.end(), choice.other_types.begin(),
                 choice.other_types.end());
    throw Error("recording " + recording.Name() + " has no topic '" +
                choice.wanted + "' (" + choice.option + ") of " +
                Joined(types, ", ") +
                "; run recording_importer without output_path to list the "
                "topics");
  }
  for (const std::string& type : choice.automatic_types) {
    std::vector<int> found;
    std::vector<std::string> names;
    for (size_t i = 0; i < topics.size(); ++i) {
      if (topics[i].type != type || topics[i].num_messages == 0) continue;
      found.push_back(static_cast<int>(i));
      names.push_back(topics[i].name);
    }
    if (found.size() == 1) return found.front();
    if (found.empty()) continue;
    context.Warning("no " + std::string(choice.content) +
                    " are imported: recording " + recording.Name() +
                    " has several topics of " + type + ", " +
                    Joined(names, ", ") + "; set " + choice.option +
                    " to one of them, or to none");
    return -1;
  }
  return -1;
}

void WarnOfMissingStamps(const std::string& subject, size_t num,
                         const char* content, const Context& context) {
  if (num == 0) return;
  context.Warning(subject + ": the headers of " + std::to_string(num) + " " +
                  content +
                  " have no time; the times at which they were received are "
                  "used for these");
}

RecordedPositions::RecordedPositions(const Recording& recording,
                                     const RecordingImportOptions& options,
                                     const Context& context)
    : recording_(recording),
      options_(options),
      context_(context),
      topic_idx_(FindTopic(recording, ChoiceOf(options), context)) {
  if (AreTransforms() && Topic().name == "/tf_static") {
    throw Error(recording.Subject(topic_idx_) +
                " has frames that do not move; set position_topic to /tf");
  }
  const bool names_frames =
      *options.body_frame != "auto" || *options.world_frame != "auto";
  if (!names_frames || AreTransforms()) return;
  throw Error("recording " + recording.Name() +
              ": body_frame and world_frame are for positions of " +
              kTransforms + "; set position_topic to such a topic, such as " +
              "/tf, or omit them");
}

bool RecordedPositions::AreGps() const {
  return topic_idx_ >= 0 && Topic().type == "sensor_msgs/NavSatFix";
}

bool RecordedPositions::AreTransforms() const {
  return topic_idx_ >= 0 && Topic().type == kTransforms;
}

int64_t RecordedPositions::TimeOf(int64_t stamp_ns, int64_t received_ns) {
  if (stamp_ns != 0) return stamp_ns;
  ++num_without_stamp_;
  return received_ns;
}

void RecordedPositions::Take(const RecordedMessage& message) {
  const std::string& encoding = Topic().encoding;
  if (AreTransforms()) {
    for (const TransformMessage& transform :
         ReadTransformMessages(message.data, encoding)) {
      moving_.Add(transform, TimeOf(transform.stamp_ns, message.received_ns));
    }
    return;
  }
  PoseMessage pose = AreGps() ? ReadNavSatFixMessage(message.data, encoding)
                              : ReadOdometryMessage(message.data, encoding);
  const int64_t time_ns = TimeOf(pose.header.stamp_ns, message.received_ns);
  if (pose.is_valid) poses_.emplace(time_ns, std::move(pose));
}

void RecordedPositions::Finish(const RecordedCamera& first,
                               const FrameTree& frames) {
  if (topic_idx_ < 0) return;
  WarnOfMissingStamps(recording_.Subject(topic_idx_), num_without_stamp_,
                      "positions", context_);
  if (!AreTransforms()) return;
  const std::string body = *options_.body_frame == "auto"
                               ? frames.RootFrom(first.frame_id).first
                               : *options_.body_frame;
  const std::string world =
      *options_.world_frame == "auto" ? "" : *options_.world_frame;
  try {
    for (const auto& [time_ns, pose] : moving_.PosesOf(body, world, frames)) {
      poses_[time_ns] = {{}, body, pose};
    }
  } catch (const Error& error) {
    throw Error(recording_.Subject(topic_idx_) + " " + error.what());
  }
}

std::string RecordedPositions::Lines(const RecordedCamera& first,
                                     const FrameTree& frames) const {
  std::string lines = AreGps()
                          ? "# SECONDS LATITUDE LONGITUDE ALTITUDE 0 0 0 1\n"
                          : "# SECONDS X Y Z QX QY QZ QW\n";
  std::optional<Rigid3> child_from_cam;
  if (!AreGps()) {
    const std::string& child = poses_.begin()->second.child;
    child_from_cam = frames.Between(child, first.frame_id);
    if (!child_from_cam) {
      context_.Warning("/tf_static does not connect the frame '" + child +
                       "' of the positions with the frame '" + first.frame_id +
                       "' of the first camera; the positions are those of '" +
                       child + "'");
    }
  }
  for (const auto& [time_ns, pose] : poses_) {
    const Rigid3 world_from_cam =
        pose.world_from_child * child_from_cam.value_or(Rigid3());
    const Eigen::Vector3d& t = world_from_cam.translation;
    const Eigen::Quaterniond& q = world_from_cam.rotation;
    lines += TimeText(time_ns);
    for (const double value : {t.x(), t.y(), t.z()}) {
      lines += ' ' + FormatDouble(value, std::chars_format::fixed, 9);
    }
    for (const double value : {q.x(), q.y(), q.z(), q.w()}) {
      lines += ' ' + FormatDouble(value, std::chars_format::general, 17);
    }
    lines += '\n';
  }
  return lines;
}

}  // namespace mgsfm
