// SPDX-License-Identifier: BSD-3-Clause
#include "translation/track_support.h"

#include <algorithm>
#include <utility>

#include "base/parallel.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// Which frames pairs join.
class JoinedFrames {
 public:
  JoinedFrames(const PositionProblem& problem,
               const std::vector<BaselineDirection>& motions,
               const Mask& pair_is_used)
      : neighbours_(problem.num_frames) {
    for (size_t i = 0; i < motions.size(); ++i) {
      const BaselineDirection& motion = motions[i];
      if (!pair_is_used[i] || motion.kind == BaselineKind::kUnused) continue;
      const int frame1 = problem.frame_idx[motion.image_idx1];
      const int frame2 = problem.frame_idx[motion.image_idx2];
      neighbours_[frame1].push_back(frame2);
      neighbours_[frame2].push_back(frame1);
    }
    for (std::vector<int>& frames : neighbours_) {
      std::sort(frames.begin(), frames.end());
      frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
    }
  }

  bool AreJoined(int frame1, int frame2) const {
    return std::binary_search(neighbours_[frame1].begin(),
                              neighbours_[frame1].end(), frame2);
  }

  // Whether a walk along joined frames, all of them given, reaches all.
  bool AreConnected(std::vector<int> frames) const {
    size_t num_reached = 1;
    for (size_t i = 0; i < num_reached && num_reached < frames.size(); ++i) {
      for (size_t k = num_reached; k < frames.size(); ++k) {
        if (AreJoined(frames[i], frames[k])) {
          std::swap(frames[num_reached++], frames[k]);
        }
      }
    }
    return num_reached >= frames.size();
  }

 private:
  std::vector<std::vector<int>> neighbours_;  // sorted, per frame
};

}  // namespace

Mask FindSupportedTracks(const PositionProblem& problem,
                         const std::vector<BaselineDirection>& motions,
                         const Mask& pair_is_used,
                         const TrackRays& rays, const TrackPoints& points,
                         int num_threads) {
  const JoinedFrames joined(problem, motions, pair_is_used);
  const ObservationGroups& tracks = rays.tracks;
  Mask is_supported(tracks.size(), false);
  ParallelFor(
      tracks.size(), num_threads,
      [&](size_t t) {
        if (!points.point_in_world[t]) return;
        std::vector<int> frames;
        for (size_t k = tracks.offsets[t]; k < tracks.offsets[t + 1]; ++k) {
          if (!points.observation_is_used[k]) continue;
          frames.push_back(problem.frame_idx[tracks.observations[k].image_idx]);
        }
        std::sort(frames.begin(), frames.end());
        frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
        is_supported[t] = joined.AreConnected(std::move(frames));
      },
      1024);
  return is_supported;
}

}  // namespace mgsfm
