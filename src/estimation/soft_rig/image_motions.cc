// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/image_motions.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "math/statistics.h"

namespace mgsfm {

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
