// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/recorded_gravity.h"

#include <charconv>
#include <cmath>
#include <utility>

#include "base/format.h"
#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "base/text.h"
#include "geometry/so3.h"
#include "priors/position_files.h"
#include "priors/timed_samples.h"
#include "recordings/recorded_positions.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Other conventions, such as a world with z down, differ by 90 or 180.
constexpr double kMaxDisagreementDeg = 30.0;

double SecondsOf(const ImuMessage& message) {
  return static_cast<double>(message.header.stamp_ns) / kNsPerSecond;
}

// Half of the variance of an angle is that about each of two axes.
std::optional<double> SigmaDeg(const std::vector<double>& angles_rad) {
  if (angles_rad.empty()) return std::nullopt;
  double sum = 0.0;
  for (const double angle : angles_rad) sum += angle * angle;
  return RadToDeg(
      std::sqrt(sum / 2.0 / static_cast<double>(angles_rad.size())));
}

// Empty if there is none. Drivers without orientation repeat one.
std::vector<TimedVector> ByOrientation(
    const std::vector<ImuMessage>& messages) {
  std::vector<TimedVector> in_imu;
  bool varies = false;
  for (const ImuMessage& message : messages) {
    const auto& orientation = message.world_from_imu;
    if (!orientation) return {};
    varies = varies ||
             orientation->coeffs() != messages.front().world_from_imu->coeffs();
    in_imu.push_back({SecondsOf(message),
                      orientation->conjugate() * -Vector3d::UnitZ(),
                      std::nullopt});
  }
  if (!varies) in_imu.clear();
  return in_imu;
}

// The axes of the first message, as the gyroscope carries them along.
std::vector<Eigen::Quaterniond> StartFromImu(
    const std::vector<ImuMessage>& messages) {
  std::vector<Eigen::Quaterniond> rotations(1, Eigen::Quaterniond::Identity());
  for (size_t k = 1; k < messages.size(); ++k) {
    const ImuMessage& before = messages[k - 1];
    const ImuMessage& after = messages[k];
    Vector3d turn = Vector3d::Zero();
    if (before.angular_velocity && after.angular_velocity) {
      turn = 0.5 * (SecondsOf(after) - SecondsOf(before)) *
             (*before.angular_velocity + *after.angular_velocity);
    }
    rotations.push_back((rotations.back() * ExpSO3(turn)).normalized());
  }
  return rotations;
}

// Empty if a message lacks an acceleration.
MeasuredGravity ByAcceleration(const std::vector<ImuMessage>& messages,
                               double window_s) {
  const auto start_from_imu = StartFromImu(messages);
  const size_t size = messages.size();
  std::vector<Vector3d> forces, means;  // in the axes of the first message
  std::vector<double> t, angles_rad;
  for (size_t k = 0; k < size; ++k) {
    if (!messages[k].acceleration) return {};
    forces.emplace_back(start_from_imu[k] * *messages[k].acceleration);
    t.push_back(SecondsOf(messages[k]));
  }
  MeasuredGravity gravity;
  Vector3d sum = Vector3d::Zero();
  size_t begin = 0, end = 0, other = 0;
  for (size_t k = 0; k < size; ++k) {
    while (end < size && t[end] - t[k] <= 0.5 * window_s) sum += forces[end++];
    while (t[k] - t[begin] > 0.5 * window_s) sum -= forces[begin++];
    means.emplace_back(-sum.normalized());
    gravity.in_imu.push_back(
        {t[k], start_from_imu[k].conjugate() * means[k], std::nullopt});
    while (other < k && t[k] - t[other + 1] >= window_s) ++other;
    if (t[k] - t[other] < window_s) continue;
    angles_rad.push_back(AngleBetween(means[other], means[k]) / std::sqrt(2.0));
  }
  gravity.sigma_deg = SigmaDeg(angles_rad);
  return gravity;
}

}  // namespace

RecordedGravity::RecordedGravity(const Recording& recording,
                                 const RecordingImportOptions& options,
                                 const Context& context)
    : recording_(recording),
      options_(options),
      context_(context),
      topic_idx_(FindTopic(
          recording,
          {"imu_topic", options.imu_topic, "gravity", {"sensor_msgs/Imu"}, {}},
          context)) {}

void RecordedGravity::Take(const RecordedMessage& message) {
  ImuMessage imu =
      ReadImuMessage(message.data, recording_.topics()[topic_idx_].encoding);
  int64_t& time_ns = imu.header.stamp_ns;
  if (time_ns == 0) {
    time_ns = message.received_ns;
    ++num_without_stamp_;
  }
  messages_.emplace(time_ns, std::move(imu));
}

std::optional<Eigen::Quaterniond> RecordedGravity::AxesFromImu(
    const RecordedCamera& first, const FrameTree& frames) const {
  if (*options_.gravity_axes == GravityAxes::kImu) {
    return Eigen::Quaterniond::Identity();
  }
  const std::string& imu = messages_.begin()->second.header.frame_id;
  const auto frame_from_imu = frames.Between(first.frame_id, imu);
  const auto image_from_frame = ImageFromFrame(first);
  if (frame_from_imu && image_from_frame) {
    return (*image_from_frame * *frame_from_imu).rotation;
  }
  context_.Warning(
      "no gravity is imported: /tf_static does not connect the frame '" + imu +
      "' of " + recording_.Subject(topic_idx_) + " with the frame '" +
      first.frame_id +
      "' of the first camera; set gravity_axes to imu, and pass the file to "
      "mapper with a body_calibration, or set imu_topic to none");
  return std::nullopt;
}

MeasuredGravity RecordedGravity::Measure() const {
  const std::vector<ImuMessage> messages =
      Transformed(messages_, [](const auto& item) { return item.second; });
  MeasuredGravity measured =
      ByAcceleration(messages, options_.gravity_window_s);
  std::vector<TimedVector> in_imu = ByOrientation(messages);
  if (in_imu.empty()) return measured;
  std::vector<double> angles_rad;
  for (size_t k = 0; k < measured.in_imu.size(); ++k) {
    angles_rad.push_back(
        AngleBetween(measured.in_imu[k].value, in_imu[k].value));
  }
  const auto sigma_deg = SigmaDeg(angles_rad);
  if (sigma_deg.value_or(0.0) < kMaxDisagreementDeg) {
    return {std::move(in_imu), sigma_deg, true};
  }
  context_.Warning(recording_.Subject(topic_idx_) +
                   " has orientations in no world with z up: their standard "
                   "deviation from the acceleration is " +
                   Formatted("%.1f", *sigma_deg) +
                   " deg; the acceleration is used instead");
  return measured;
}

std::string RecordedGravity::Lines(const RecordedCamera& first,
                                   const FrameTree& frames,
                                   const std::vector<int64_t>& times_ns) const {
  if (messages_.empty()) return "";
  WarnOfMissingStamps(recording_.Subject(topic_idx_), num_without_stamp_,
                      "messages", context_);
  const auto axes_from_imu = AxesFromImu(first, frames);
  if (!axes_from_imu) return "";
  const MeasuredGravity measured = Measure();
  const double max_gap_s = MaxGapSeconds(measured.in_imu);
  std::string lines;
  for (const int64_t time_ns : times_ns) {
    const auto place = FindBetween(measured.in_imu, max_gap_s,
                                   static_cast<double>(time_ns) / kNsPerSecond);
    if (!place) continue;
    const Vector3d direction =
        *axes_from_imu * ((1.0 - place->share) * place->before->value +
                          place->share * place->after->value);
    lines += TimeText(time_ns);
    for (const double value : direction.normalized()) {
      lines += ' ' + FormatDouble(value, std::chars_format::fixed, 9);
    }
    lines += '\n';
  }
  if (lines.empty()) {
    context_.Warning(
        "no gravity is imported: " + recording_.Subject(topic_idx_) +
        " has no acceleration at the times of the images; set "
        "imu_topic to another one, or to none");
    return "";
  }
  const std::string sigma =
      measured.sigma_deg
          ? Formatted("standard deviation %.2f deg", *measured.sigma_deg)
          : "unknown standard deviation";
  const std::string source =
      (measured.is_by_orientation
           ? "by the orientation in "
           : Formatted("by the mean acceleration over %g s in ",
                       *options_.gravity_window_s)) +
      recording_.topics()[topic_idx_].name + ", " + sigma;
  context_.Info("gravity: " + source);
  return "# SECONDS GX GY GZ, " + source + "\n" + lines;
}

}  // namespace mgsfm
