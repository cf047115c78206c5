// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_trajectory.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

Vector3d RotationBetween(const Rigid3& from, const Rigid3& to) {
  return LogSO3(to.rotation * from.rotation.conjugate());
}

// Cubic from 0 at u = 0 to `end` at u = 1 with these derivatives at both ends.
Vector3d Hermite(const Vector3d& start_rate, const Vector3d& end,
                 const Vector3d& end_rate, double u) {
  const double v = 1.0 - u;
  return u * v * v * start_rate + u * u * (3.0 - 2.0 * u) * end -
         u * u * v * end_rate;
}

}  // namespace

RigTrajectory::RigTrajectory(std::vector<double> times_s,
                             std::vector<Rigid3> rig_from_world)
    : times_s_(std::move(times_s)), poses_(std::move(rig_from_world)) {
  MGSFM_CHECK_EQ(times_s_.size(), poses_.size());
  MGSFM_CHECK(!poses_.empty());
  SetVelocities();
}

void RigTrajectory::SetVelocities() {
  const size_t size = poses_.size();
  angular_velocities_.assign(size, Vector3d::Zero());
  velocities_.assign(size, Vector3d::Zero());
  if (size < 2) return;
  const auto interval = [&](size_t k) { return times_s_[k + 1] - times_s_[k]; };
  const auto angular_velocity = [&](size_t k) -> Vector3d {
    return RotationBetween(poses_[k], poses_[k + 1]) / interval(k);
  };
  const auto velocity = [&](size_t k) -> Vector3d {
    return (poses_[k + 1].Center() - poses_[k].Center()) / interval(k);
  };
  for (size_t k = 0; k < size; ++k) {
    if (k == 0 || k + 1 == size) {
      const size_t segment = k == 0 ? 0 : size - 2;
      angular_velocities_[k] = angular_velocity(segment);
      velocities_[k] = velocity(segment);
      continue;
    }
    const double before = interval(k - 1), after = interval(k);
    const double sum = before + after;
    angular_velocities_[k] =
        (after * angular_velocity(k - 1) + before * angular_velocity(k)) / sum;
    velocities_[k] = (after * velocity(k - 1) + before * velocity(k)) / sum;
  }
}

size_t RigTrajectory::SegmentAt(double time_s) const {
  const auto after =
      std::upper_bound(times_s_.begin() + 1, times_s_.end() - 1, time_s);
  return static_cast<size_t>(after - times_s_.begin()) - 1;
}

double RigTrajectory::MedianInterval() const {
  return MedianDifference(times_s_).value_or(
      std::numeric_limits<double>::infinity());
}

PoseVector RigTrajectory::VelocityAt(double time_s) const {
  if (poses_.size() < 2) return PoseVector::Zero();
  // Half the step of central differences: small compared with the interval over
  // which velocity changes, large compared with rounding errors.
  const size_t k = SegmentAt(time_s);
  const double h = 1e-3 * (times_s_[k + 1] - times_s_[k]);
  const Rigid3 before = PoseAt(time_s - h), after = PoseAt(time_s + h);
  PoseVector velocity;
  velocity << RotationBetween(before, after), after.Center() - before.Center();
  return velocity / (2.0 * h);
}

Rigid3 RigTrajectory::Extrapolate(size_t frame, double time_s) const {
  const double time = time_s - times_s_[frame];
  return Rigid3::FromRotationAndCenter(
      (ExpSO3(time * angular_velocities_[frame]) * poses_[frame].rotation)
          .normalized(),
      poses_[frame].Center() + time * velocities_[frame]);
}

Rigid3 RigTrajectory::PoseAt(double time_s) const {
  if (poses_.size() < 2 || time_s < times_s_.front()) {
    return Extrapolate(0, time_s);
  }
  if (time_s > times_s_.back()) return Extrapolate(poses_.size() - 1, time_s);
  const size_t k = SegmentAt(time_s);
  const double interval = times_s_[k + 1] - times_s_[k];
  const double u = (time_s - times_s_[k]) / interval;
  const Vector3d rotation = RotationBetween(poses_[k], poses_[k + 1]);
  // The derivative of the logarithm at the end of the segment.
  const Vector3d end_rate =
      InverseRightJacobianSO3(-rotation) * angular_velocities_[k + 1];
  const Vector3d rotated = Hermite(interval * angular_velocities_[k], rotation,
                                   interval * end_rate, u);
  const Vector3d start = poses_[k].Center();
  const Vector3d moved =
      Hermite(interval * velocities_[k], poses_[k + 1].Center() - start,
              interval * velocities_[k + 1], u);
  return Rigid3::FromRotationAndCenter(
      (ExpSO3(rotated) * poses_[k].rotation).normalized(), start + moved);
}

namespace {

// Per rig; nullopt if none of its frames is registered.
std::vector<std::optional<RigTrajectory>> MakeTrajectories(
    const Scene& scene, const CaptureTimes& times,
    const Reconstruction& model) {
  const auto frames = FramesOfRigs(scene, times, model);
  std::vector<std::optional<RigTrajectory>> trajectories(scene.rigs.size());
  for (size_t r = 0; r < frames.size(); ++r) {
    if (frames[r].empty()) continue;
    std::vector<double> times_of_rig;
    std::vector<Rigid3> poses;
    for (const auto& [time, frame_idx] : frames[r]) {
      times_of_rig.push_back(time);
      poses.push_back(*model.rig_from_world[frame_idx]);
    }
    trajectories[r].emplace(std::move(times_of_rig), std::move(poses));
  }
  return trajectories;
}

RigMotion MotionBetween(const Rigid3& from, const Rigid3& to) {
  return {(to.rotation * from.rotation.conjugate()).normalized(),
          to.Center() - from.Center()};
}

}  // namespace

std::vector<std::vector<std::pair<double, int>>> FramesOfRigs(
    const Scene& scene, const CaptureTimes& times,
    const Reconstruction& model) {
  std::vector<std::vector<std::pair<double, int>>> frames(scene.rigs.size());
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    if (!model.rig_from_world[f]) continue;
    frames[scene.frames[f].rig_idx].emplace_back(times.frames[f],
                                                 static_cast<int>(f));
  }
  for (auto& of_rig : frames) std::sort(of_rig.begin(), of_rig.end());
  return frames;
}

ImageMotions FindImageMotions(const Scene& scene, const CaptureTimes& times,
                              const std::vector<double>& delays,
                              const Reconstruction& model) {
  const auto trajectories = MakeTrajectories(scene, times, model);
  ImageMotions motions{
      std::vector<RigMotion>(scene.images.size()),
      std::vector<PoseVector>(scene.images.size(), PoseVector::Zero()),
      {}};
  for (const auto& trajectory : trajectories) {
    motions.median_intervals.push_back(
        trajectory ? trajectory->MedianInterval()
                   : std::numeric_limits<double>::infinity());
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    const auto& frame = model.rig_from_world[image.frame_idx];
    if (!frame) continue;
    const RigTrajectory& trajectory =
        *trajectories[scene.frames[image.frame_idx].rig_idx];
    const double time = times.images[i] + delays[image.sensor_idx];
    motions.rates[i] = trajectory.VelocityAt(time);
    if (time != times.frames[image.frame_idx]) {
      motions.since_frame[i] = MotionBetween(*frame, trajectory.PoseAt(time));
    }
  }
  return motions;
}

}  // namespace mgsfm
