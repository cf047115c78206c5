// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/recorded_priors.h"

#include <algorithm>
#include <charconv>
#include <functional>
#include <utility>

#include "base/format.h"
#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"
#include "priors/timed_samples.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

constexpr const char* kTransforms = "tf2_msgs/TFMessage";

// The noise with which gravity keeps all pairs (docs/results/constants.md).
constexpr double kMaxGravitySigmaDeg = 5.0;

using Tell = std::function<void(const std::string&)>;

// The topic that an option names or, if it is auto, the only one of the first
// type that has messages; -1 for none, and for several, of which it tells. /tf
// must be named; /tf_static does not move.
int FindTopic(const Recording& recording, const std::string& option,
              const std::string& wanted, const std::vector<std::string>& types,
              const Tell& tell) {
  if (wanted == "none") return -1;
  const bool is_automatic = wanted == "auto";
  const std::vector<RecordingTopic>& topics = recording.topics();
  for (const std::string& type : types) {
    int found = -1;
    std::vector<std::string> names;
    for (size_t i = 0; i < topics.size(); ++i) {
      const bool is_chosen =
          is_automatic ? topics[i].num_messages > 0 && type != kTransforms
                       : topics[i].name == wanted && wanted != "/tf_static";
      if (topics[i].type != type || !topics[i].IsReadable() || !is_chosen) {
        continue;
      }
      found = static_cast<int>(i);
      names.push_back(topics[i].name);
    }
    if (names.size() == 1) return found;
    if (names.empty()) continue;
    tell(Formatted(
        "recording %s has several topics of %s, %s; set %s to one of them, or "
        "to none",
        recording.Name().c_str(), type.c_str(), Joined(names, ", ").c_str(),
        option.c_str()));
    return -1;
  }
  if (is_automatic) return -1;
  throw Error("recording " + recording.Name() + " has no topic '" + wanted +
              "' (" + option + ") of " + Joined(types, ", ") +
              " that can be read; run recording_importer without output_path "
              "to list the topics");
}

}  // namespace

std::string TimeText(int64_t time_ns) {
  return Formatted("%06lld.%09lld",
                   static_cast<long long>(time_ns / kNsPerSecond),
                   static_cast<long long>(time_ns % kNsPerSecond));
}

RecordedPriors::RecordedPriors(const Recording& recording,
                               const RecordingImportOptions& options,
                               const Context& context)
    : recording_(recording),
      options_(options),
      context_(context),
      position_topic_(
          FindTopic(recording, "position_topic", options.position_topic,
                    {"sensor_msgs/NavSatFix", "nav_msgs/Odometry", kTransforms},
                    [&](const std::string& why) {
                      context.Warning("no positions are imported: " + why);
                    })),
      imu_topic_(FindTopic(recording, "imu_topic", options.imu_topic,
                           {"sensor_msgs/Imu"},
                           [&](const std::string& why) { NoGravity(why); })) {
  const bool names_frames =
      *options.body_frame != "auto" || *options.world_frame != "auto";
  if (!names_frames || PositionsAreTransforms()) return;
  throw Error("recording " + recording.Name() +
              ": body_frame and world_frame are for positions of " +
              kTransforms + "; set position_topic to such a topic, such as " +
              "/tf, or omit them");
}

bool RecordedPriors::PositionsAreGps() const {
  return position_topic_ >= 0 &&
         PositionTopic().type == "sensor_msgs/NavSatFix";
}

bool RecordedPriors::PositionsAreTransforms() const {
  return position_topic_ >= 0 && PositionTopic().type == kTransforms;
}

int64_t RecordedPriors::TimeOf(int64_t stamp_ns,
                               const RecordedMessage& message) {
  if (stamp_ns != 0) return stamp_ns;
  ++num_without_stamp_[message.topic_idx];
  return message.received_ns;
}

void RecordedPriors::Take(const RecordedMessage& message) {
  if (message.topic_idx == position_topic_) return TakePosition(message);
  const std::string& encoding = recording_.topics()[imu_topic_].encoding;
  ImuMessage imu = ReadImuMessage(message.data, encoding);
  imu.stamp_ns = TimeOf(imu.stamp_ns, message);
  if (imu_.empty()) {
    imu_frame_ = ReadMessageHeader(message.data, encoding).frame_id;
  }
  imu_.push_back(imu);
}

void RecordedPriors::TakePosition(const RecordedMessage& message) {
  const std::string& encoding = PositionTopic().encoding;
  if (PositionsAreTransforms()) {
    for (const TransformMessage& transform :
         ReadTransformMessages(message.data, encoding)) {
      moving_.Add(transform, TimeOf(transform.stamp_ns, message));
    }
    return;
  }
  PoseMessage pose = PositionsAreGps()
                         ? ReadNavSatFixMessage(message.data, encoding)
                         : ReadOdometryMessage(message.data, encoding);
  const int64_t time_ns = TimeOf(pose.header.stamp_ns, message);
  if (pose.is_valid) positions_.emplace(time_ns, std::move(pose));
}

void RecordedPriors::Finish(const RecordedCamera& first,
                            const FrameTree& frames) {
  for (const auto& [topic_idx, num] : num_without_stamp_) {
    context_.Warning(recording_.Subject(topic_idx) + ": " +
                     std::to_string(num) +
                     (topic_idx == imu_topic_ ? " messages" : " positions") +
                     " have no time in their headers; the times at which they "
                     "were received are used for these");
  }
  StableSortBy(&imu_, &ImuMessage::stamp_ns);
  const auto is_repeated = [](const ImuMessage& a, const ImuMessage& b) {
    return a.stamp_ns == b.stamp_ns;
  };
  imu_.erase(std::unique(imu_.begin(), imu_.end(), is_repeated), imu_.end());
  if (!PositionsAreTransforms()) return;
  const std::string body = *options_.body_frame == "auto"
                               ? frames.RootFrom(first.frame_id).first
                               : *options_.body_frame;
  const std::string world =
      *options_.world_frame == "auto" ? "" : *options_.world_frame;
  try {
    for (const auto& [time_ns, pose] : moving_.PosesOf(body, world, frames)) {
      positions_[time_ns] = {{}, body, pose};
    }
  } catch (const Error& error) {
    throw Error(recording_.Subject(position_topic_) + " " + error.what());
  }
}

std::string RecordedPriors::PositionLines(const RecordedCamera& first,
                                          const FrameTree& frames) const {
  if (positions_.empty()) return "";
  std::string lines = PositionsAreGps()
                          ? "# SECONDS LATITUDE LONGITUDE ALTITUDE 0 0 0 1\n"
                          : "# SECONDS X Y Z QX QY QZ QW\n";
  std::optional<Rigid3> child_from_cam;
  if (!PositionsAreGps()) {
    const std::string& child = positions_.begin()->second.child;
    child_from_cam = frames.Between(child, first.frame_id);
    if (!child_from_cam) {
      context_.Warning("/tf_static does not connect the frame '" + child +
                       "' of the positions with the frame '" + first.frame_id +
                       "' of the first camera; the positions are those of '" +
                       child + "'");
    }
  }
  for (const auto& [time_ns, pose] : positions_) {
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

void RecordedPriors::NoGravity(const std::string& why) const {
  const std::string text = "no gravity is imported: " + why;
  *options_.imu_topic == "auto" ? context_.Info(text) : context_.Warning(text);
}

std::optional<Eigen::Quaterniond> RecordedPriors::AxesFromImu(
    const RecordedCamera& first, const FrameTree& frames) const {
  if (*options_.gravity_axes == GravityAxes::kImu) {
    return Eigen::Quaterniond::Identity();
  }
  const auto frame_from_imu = frames.Between(first.frame_id, imu_frame_);
  const auto image_from_frame = ImageFromFrame(first);
  if (!imu_frame_.empty() && frame_from_imu && image_from_frame) {
    return (*image_from_frame * *frame_from_imu).rotation;
  }
  NoGravity((image_from_frame
                 ? "/tf_static does not connect the frame '" + imu_frame_ +
                       "' of " + recording_.Subject(imu_topic_) +
                       " with the frame '" + first.frame_id +
                       "' of the first camera"
                 : recording_.Subject(first.info_topic_idx) +
                       " has an R that is no rotation") +
            "; set gravity_axes to imu, and pass the file to mapper with a "
            "body_calibration, or set imu_topic to none");
  return std::nullopt;
}

std::string RecordedPriors::GravityLines(const RecordedCamera& first,
                                         const FrameTree& frames,
                                         const std::vector<int64_t>& times_ns) {
  if (imu_.empty()) return "";
  const auto axes_from_imu = AxesFromImu(first, frames);
  if (!axes_from_imu) return "";
  const MeasuredGravity measured =
      MeasureGravity(std::move(imu_), options_.gravity_window_s);
  const double max_gap_s = MaxGapSeconds(measured.in_imu);
  std::string lines;
  for (const int64_t time_ns : times_ns) {
    const auto place =
        FindBetween(measured.in_imu, max_gap_s, Seconds(time_ns));
    if (!place) continue;
    const Vector3d direction = *axes_from_imu * Interpolate(*place).value;
    if (direction.isZero(0.0)) continue;
    lines += TimeText(time_ns);
    for (const double value : direction.normalized()) {
      lines += ' ' + FormatDouble(value, std::chars_format::fixed, 9);
    }
    lines += '\n';
  }
  if (lines.empty()) {
    NoGravity(recording_.Subject(imu_topic_) +
              (!measured.in_imu.empty()
                   ? " has no message at the times of the images"
               : measured.mean_acceleration
                   ? Formatted(" has no orientation that changes, and a mean "
                               "acceleration of %.2f instead of 9.81 m/s^2",
                               *measured.mean_acceleration)
                   : " has no acceleration, and no orientation that changes") +
              "; set imu_topic to another one, or to none");
    return "";
  }
  const std::string source =
      (measured.is_by_orientation
           ? "by the orientation in "
           : Formatted("by the mean acceleration over %g s in ",
                       *options_.gravity_window_s)) +
      recording_.topics()[imu_topic_].name + ", " +
      (measured.sigma_deg
           ? Formatted("standard deviation %.2f deg", *measured.sigma_deg)
           : "unknown standard deviation");
  context_.Info("gravity: " + source);
  if (measured.sigma_deg.value_or(0.0) > kMaxGravitySigmaDeg) {
    context_.Warning(Formatted(
        "gravity has a standard deviation of more than %g deg; change "
        "gravity_window_s or set imu_topic to none",
        kMaxGravitySigmaDeg));
  }
  return "# SECONDS GX GY GZ in the axes of " +
         (*options_.gravity_axes == GravityAxes::kImu
              ? "the frame '" + imu_frame_ + "'"
              : "the camera '" + first.folder + "'") +
         ", " + source + "\n" + lines;
}

}  // namespace mgsfm
