// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <string_view>
#include <vector>

#include "matching/pair_selection.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Key frames: the frames of a sequence that see something new.
//
// At a high frame rate, neighbors see the same points from nearly the same
// place, so that most pairs of them add neither points nor parallax. The
// structure of the scene comes from key frames; a frame between two of them is
// tied to both and to its neighbors.
//
// Intervals between key frames grow by doubling. At first, all frames are key
// frames. The frame m between two neighboring intervals [a, m] and [m, b] of
// 2^k frames is none if the images of every sensor in a and b have at least
// kMinShareOfInliers of the inliers that those of consecutive frames in [a, b]
// have on average. The ratio measures what the views share: the repeatability
// of features cancels. Frames beside a step that no sensor verifies stay key
// frames.
//
// Cost: at most four pairs per frame and sensor, in log2 of the longest
// interval batches.
struct KeyFrames {
  std::vector<FrameSequence> sequences;  // the key frames of each sequence
  // Of one sensor: the pairs that were matched to find the key frames, and each
  // other frame with the key frames before and after it.
  ImagePairList ties;
};

// Matches pairs, and counts their inliers: 0 for pairs that are not verified.
struct PairTrial {
  std::function<void(const ImagePairList& pairs, std::string_view stage)> match;
  std::function<size_t(const ImageIdxPair& pair)> num_inliers;
};

[[nodiscard]] KeyFrames FindKeyFrames(
    const std::vector<FrameSequence>& sequences, const PairTrial& trial);

// The pairs of sequential matching, but for loops: SameSensorPairs() and
// OverlappingSensorPairs() of key frames, the images within each frame, and the
// ties of the other frames.
struct NeighborPairs {
  std::vector<FrameSequence> key_frames;
  ImagePairList pairs;
};

[[nodiscard]] NeighborPairs SelectNeighbors(
    const Scene& scene, const SequentialPairOptions& options,
    const PairTrial& trial);

}  // namespace mgsfm
