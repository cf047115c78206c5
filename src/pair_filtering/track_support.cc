// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/track_support.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Neighbours = std::vector<std::vector<int>>;  // per frame, sorted

// Frames that an accepted pair connects.
Neighbours ConnectedFrames(const FramePairIndex& index,
                           const Mask& pair_is_accepted) {
  Neighbours neighbours(index.num_frames());
  for (const FramePairIndex::FramePair& frames : index.frame_pairs()) {
    if (!frames.IsBetweenFrames() ||
        std::none_of(frames.pair_idxs.begin(), frames.pair_idxs.end(),
                     [&](size_t i) { return pair_is_accepted[i]; })) {
      continue;
    }
    neighbours[frames.frame_idx1].push_back(frames.frame_idx2);
    neighbours[frames.frame_idx2].push_back(frames.frame_idx1);
  }
  for (std::vector<int>& frames : neighbours) {
    std::sort(frames.begin(), frames.end());
  }
  return neighbours;
}

// Breadth-first search among `frames`; those reached come first.
bool AreConnected(const Neighbours& neighbours, std::vector<int> frames) {
  size_t num_reached = 1;
  for (size_t i = 0; i < num_reached && num_reached < frames.size(); ++i) {
    const std::vector<int>& reachable = neighbours[frames[i]];
    for (size_t k = num_reached; k < frames.size(); ++k) {
      if (std::binary_search(reachable.begin(), reachable.end(), frames[k])) {
        std::swap(frames[num_reached++], frames[k]);
      }
    }
  }
  return num_reached >= frames.size();
}

}  // namespace

Mask FindSupportedTracks(const Scene& scene, const FramePairIndex& index,
                         const Mask& pair_is_accepted,
                         const ObservationGroups& tracks,
                         const Mask& track_is_used,
                         const Mask& observation_is_used, int num_threads) {
  MGSFM_CHECK_EQ(pair_is_accepted.size(), index.num_pairs());
  MGSFM_CHECK_EQ(track_is_used.size(), tracks.size());
  MGSFM_CHECK_EQ(observation_is_used.size(), tracks.observations.size());
  const Neighbours neighbours = ConnectedFrames(index, pair_is_accepted);
  Mask is_supported(tracks.size(), false);
  ParallelFor(
      tracks.size(), num_threads,
      [&](size_t t) {
        if (!track_is_used[t]) return;
        std::vector<int> frames;
        for (size_t k = tracks.offsets[t]; k < tracks.offsets[t + 1]; ++k) {
          if (!observation_is_used[k]) continue;
          frames.push_back(
              scene.images[tracks.observations[k].image_idx].frame_idx);
        }
        std::sort(frames.begin(), frames.end());
        frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
        is_supported[t] = AreConnected(neighbours, std::move(frames));
      },
      1024);
  return is_supported;
}

}  // namespace mgsfm
