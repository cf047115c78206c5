// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/imu_gravity.h"

#include <cmath>
#include <utility>

#include "base/nanoseconds.h"
#include "geometry/so3.h"

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

MeasuredGravity MeasureGravity(const std::vector<ImuMessage>& messages,
                               double window_s) {
  MeasuredGravity measured = ByAcceleration(messages, window_s);
  std::vector<TimedVector> in_imu = ByOrientation(messages);
  if (in_imu.empty()) return measured;
  std::vector<double> angles_rad;
  for (size_t k = 0; k < measured.in_imu.size(); ++k) {
    angles_rad.push_back(
        AngleBetween(measured.in_imu[k].value, in_imu[k].value));
  }
  const auto sigma_deg = SigmaDeg(angles_rad);
  if (sigma_deg.value_or(0.0) > kMaxDisagreementDeg) return measured;
  return {std::move(in_imu), sigma_deg, true};
}

}  // namespace mgsfm
