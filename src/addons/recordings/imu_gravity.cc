// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/imu_gravity.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "priors/timed_samples.h"
#include "video/sampling_plan.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

constexpr double kGravity = 9.81;  // m/s^2
// Other conventions, such as a world with z down, differ by 90 or 180.
constexpr double kMaxDisagreementDeg = 30.0;
// 1 / cos(30 deg) - 1: a horizontal acceleration that turns means by the angle
// above makes them longer by this. Without gravity, and over turns that no
// gyroscope measures, means are much shorter.
constexpr double kMaxLengthError = 0.15;

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
  const Eigen::Quaterniond* first = nullptr;
  bool varies = false;
  for (const ImuMessage& message : messages) {
    if (!message.world_from_imu) continue;
    const Eigen::Quaterniond& orientation = *message.world_from_imu;
    if (first == nullptr) first = &orientation;
    varies = varies || orientation.coeffs() != first->coeffs();
    in_imu.push_back({Seconds(message.stamp_ns),
                      orientation.conjugate() * -Vector3d::UnitZ(),
                      std::nullopt});
  }
  if (!varies) in_imu.clear();
  return in_imu;
}

// The axes of the first of the messages, as the gyroscope carries them along.
std::vector<Eigen::Quaterniond> StartFromImu(const ImuMessage* messages,
                                             size_t size) {
  std::vector<Eigen::Quaterniond> rotations(1, Eigen::Quaterniond::Identity());
  for (size_t k = 1; k < size; ++k) {
    const ImuMessage& before = messages[k - 1];
    const ImuMessage& after = messages[k];
    Vector3d turn = Vector3d::Zero();
    if (before.angular_velocity && after.angular_velocity) {
      turn = 0.5 * Seconds(after.stamp_ns - before.stamp_ns) *
             (*before.angular_velocity + *after.angular_velocity);
    }
    rotations.push_back((rotations.back() * ExpSO3(turn)).normalized());
  }
  return rotations;
}

// Of windows around the messages.
struct MeanAccelerations {
  std::vector<TimedVector> gravity_in_imu;
  std::vector<double> lengths;
  std::vector<double> angles_rad;  // about an axis, between adjacent windows

  // Adds those of messages without a gap.
  void Add(const ImuMessage* messages, size_t size, double window_s) {
    const auto start_from_imu = StartFromImu(messages, size);
    std::vector<Vector3d> forces, means;  // in the axes of the first message
    std::vector<double> t;
    for (size_t k = 0; k < size; ++k) {
      forces.emplace_back(start_from_imu[k] * *messages[k].acceleration);
      t.push_back(Seconds(messages[k].stamp_ns));
    }
    Vector3d sum = Vector3d::Zero();
    size_t begin = 0, end = 0, other = 0;
    for (size_t k = 0; k < size; ++k) {
      while (end < size && t[end] - t[k] <= 0.5 * window_s) {
        sum += forces[end++];
      }
      while (t[k] - t[begin] > 0.5 * window_s) sum -= forces[begin++];
      lengths.push_back(sum.norm() / static_cast<double>(end - begin));
      means.emplace_back(-sum.normalized());
      gravity_in_imu.push_back(
          {t[k], start_from_imu[k].conjugate() * means[k], std::nullopt});
      while (other < k && t[k] - t[other + 1] >= window_s) ++other;
      if (t[k] - t[other] < window_s) continue;
      angles_rad.push_back(AngleBetween(means[other], means[k]) /
                           std::sqrt(2.0));
    }
  }
};

// Parts without gaps, over which nothing tells how the axes turn, by begin and
// end. At its ends, a part has half of a window: shorter parts are left out,
// unless there are no longer ones.
std::vector<std::pair<size_t, size_t>> FindParts(
    const std::vector<ImuMessage>& messages, double window_s) {
  const auto t_ns = Transformed(messages, &ImuMessage::stamp_ns);
  const double max_gap_s =
      kMaxGapRatio * Seconds(MedianInterval(t_ns).value_or(0));
  std::vector<std::pair<size_t, size_t>> parts;
  double longest_s = 0.0;
  for (size_t begin = 0, end = 1; begin < t_ns.size(); begin = end++) {
    while (end < t_ns.size() &&
           Seconds(t_ns[end] - t_ns[end - 1]) <= max_gap_s) {
      ++end;
    }
    parts.emplace_back(begin, end);
    longest_s = std::max(longest_s, Seconds(t_ns[end - 1] - t_ns[begin]));
  }
  EraseIf(&parts, [&](const auto& part) {
    return Seconds(t_ns[part.second - 1] - t_ns[part.first]) <
           std::min(longest_s, 0.5 * window_s);
  });
  return parts;
}

MeasuredGravity ByAcceleration(std::vector<ImuMessage> messages,
                               double window_s) {
  EraseIf(&messages, [](const auto& message) { return !message.acceleration; });
  MeasuredGravity gravity;
  if (messages.empty()) return gravity;
  MeanAccelerations means;
  for (const auto& [begin, end] : FindParts(messages, window_s)) {
    means.Add(messages.data() + begin, end - begin, window_s);
  }
  gravity.mean_acceleration = UpperMedian(std::move(means.lengths));
  gravity.sigma_deg = SigmaDeg(means.angles_rad);
  const double error = std::abs(*gravity.mean_acceleration / kGravity - 1.0);
  if (error <= kMaxLengthError) {
    gravity.in_imu = std::move(means.gravity_in_imu);
  }
  return gravity;
}

}  // namespace

MeasuredGravity MeasureGravity(std::vector<ImuMessage> messages,
                               double window_s) {
  std::vector<TimedVector> in_imu = ByOrientation(messages);
  MeasuredGravity measured = ByAcceleration(std::move(messages), window_s);
  if (in_imu.empty()) return measured;
  const double max_gap_s = MaxGapSeconds(in_imu);
  std::vector<double> angles_rad;
  for (const TimedVector& mean : measured.in_imu) {
    const auto place = FindBetween(in_imu, max_gap_s, mean.timestamp_s);
    if (!place) continue;
    angles_rad.push_back(AngleBetween(mean.value, Interpolate(*place).value));
  }
  const auto sigma_deg = SigmaDeg(angles_rad);
  if (sigma_deg.value_or(0.0) > kMaxDisagreementDeg) return measured;
  return {std::move(in_imu), sigma_deg, measured.mean_acceleration, true};
}

}  // namespace mgsfm
