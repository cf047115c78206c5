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

PoseVector RigTrajectory::VelocityAt(size_t frame) const {
  PoseVector velocity;
  velocity << angular_velocities_[frame], velocities_[frame];
  return velocity;
}

size_t RigTrajectory::SegmentAt(double time_s) const {
  const auto after =
      std::upper_bound(times_s_.begin() + 1, times_s_.end() - 1, time_s);
  return static_cast<size_t>(after - times_s_.begin()) - 1;
}

double RigTrajectory::IntervalAt(double time_s) const {
  if (poses_.size() < 2) return std::numeric_limits<double>::infinity();
  const size_t k = SegmentAt(time_s);
  return times_s_[k + 1] - times_s_[k];
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

ImageMotions::ImageMotions(const Scene& scene, bool use_times)
    : scene_(scene), use_times_(use_times) {}

void ImageMotions::SetTrajectories(const Reconstruction& reconstruction) {
  if (!use_times_) return;
  std::vector<std::vector<std::pair<double, int>>> frames(scene_.rigs.size());
  world_from_rig_.resize(scene_.frames.size());
  for (size_t i = 0; i < scene_.frames.size(); ++i) {
    const auto& pose = reconstruction.rig_from_world[i];
    if (!pose) continue;
    world_from_rig_[i] = pose->Inverse();
    const int frame_idx = static_cast<int>(i);
    frames[scene_.frames[i].rig_idx].emplace_back(
        TimeOfFrame(scene_, frame_idx), frame_idx);
  }
  trajectories_.clear();
  trajectories_.resize(scene_.rigs.size());
  median_interval_.assign(scene_.rigs.size(),
                          std::numeric_limits<double>::infinity());
  for (size_t r = 0; r < frames.size(); ++r) {
    if (frames[r].empty()) continue;
    std::sort(frames[r].begin(), frames[r].end());
    std::vector<double> times_s, intervals_s;
    std::vector<Rigid3> poses;
    for (const auto& [time_s, frame_idx] : frames[r]) {
      if (!times_s.empty()) intervals_s.push_back(time_s - times_s.back());
      times_s.push_back(time_s);
      poses.push_back(*reconstruction.rig_from_world[frame_idx]);
    }
    trajectories_[r].emplace(std::move(times_s), std::move(poses));
    if (!intervals_s.empty()) median_interval_[r] = Median(intervals_s);
  }
}

const RigTrajectory& ImageMotions::TrajectoryOf(int image_idx) const {
  const int frame_idx = scene_.images[image_idx].frame_idx;
  return trajectories_[scene_.frames[frame_idx].rig_idx].value();
}

Rigid3 ImageMotions::MotionOf(int image_idx, double offset_s) const {
  if (!use_times_) return {};
  const Image& image = scene_.images[image_idx];
  return TrajectoryOf(image_idx).PoseAt(*image.timestamp_s + offset_s) *
         world_from_rig_[image.frame_idx];
}

double ImageMotions::IntervalAt(int image_idx, double offset_s) const {
  return TrajectoryOf(image_idx).IntervalAt(
      *scene_.images[image_idx].timestamp_s + offset_s);
}

double ImageMotions::MedianInterval(int rig_idx) const {
  return use_times_ ? median_interval_[rig_idx]
                    : std::numeric_limits<double>::infinity();
}

}  // namespace mgsfm
