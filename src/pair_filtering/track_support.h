// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Tracks are established from all matches, also those of pairs that are
// rejected later. Such a match can merge two tracks: the point is wrong, and it
// ties together unrelated frames. Some thousand such ties destroy the small
// separators of the frame graph of a drive, and with them the linear cost of
// its elimination.
//
// Per track of `tracks`: true if accepted pairs connect the frames of its used
// observations, without leaving these frames. False for tracks that
// `track_is_used` excludes.
// Cost: O(n^2 log d) for a track of n frames with d neighbours; in parallel.
Mask FindSupportedTracks(const Scene& scene, const FramePairIndex& index,
                         const Mask& pair_is_accepted,
                         const ObservationGroups& tracks,
                         const Mask& track_is_used,
                         const Mask& observation_is_used, int num_threads);

}  // namespace mgsfm
