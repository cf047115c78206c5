// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mapper/mapper_recipe.h"
#include "mapper/verified_pairs.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Which pairs a model may grow on. Growth registers one frame at a time and
// sees no loop before it closes: pairs of two places that look alike attach the
// frames of one place to the other, and what follows agrees with them.

// Finds objects that move along with the rig of a sequence, if the rule is on,
// by the pairs of the given frames; nullptr: of all. Pairs of which the static
// scene is known replace those of the view graph. Logs how many others
// contradict the motion of the rig.
[[nodiscard]] MotionOfScene RemoveMovingObjects(
    const MapperRunInput& run, const FramePairIndex& index, const Mask* frames,
    const RotationEstimate& rotations, VerifiedPairs* pairs,
    std::vector<StageTime>* times);

// Averages positions from pairs alone, per component, and rejects the pairs
// that contradict them, by the rules on baselines (translation_averaging/
// position_estimation.h): rotations do not tell parallel streets apart. Without
// loop pairs in a sequence, nothing is rejected. Cost: an iteration is linear
// in the pairs.
void RejectByPositions(const MapperRunInput& run, const VerifiedPairs& pairs,
                       const FramePairIndex& index, JudgedPairs* judged,
                       std::vector<StageTime>* times);

// Per pair: joins neighbors in a sequence, without a break between them.
[[nodiscard]] Mask FindPairsOfNeighbors(const FramePairIndex& index);

// The pairs that extend an existing model.
struct PairsOfExtension {
  // Pairs with an image that the model lacks, and some pairs of its images.
  ViewGraph matches;
  // All pairs of images of the model, by their matches that observe its points.
  std::vector<MatchedImages> of_model;
};

// The pairs of images that the existing model has form two disjoint spanning
// forests, neighbors in time and many matches that observe points of the model
// first. They give the rules the relative placement of the frames of the model.
// nullopt if all pairs are needed: there is no model, it has no points, or it
// has all images. Cost: a pass over all matches.
[[nodiscard]] std::optional<PairsOfExtension> SelectPairsOfExtension(
    const MapperRunInput& run);

struct PairsToGrowOn {
  PairVerdicts verdicts;
  Mask pair_is_of_neighbors;
};

// The verdicts of all rules on verified pairs; `selected` is null if these are
// all pairs. Order and reach of the frames are those of all pairs. Moving
// objects are sought in pairs of new frames and of frames that share a pair
// with these.
[[nodiscard]] PairsToGrowOn JudgePairsOfExtension(
    const MapperRunInput& run, const PairsOfExtension* selected,
    VerifiedPairs* pairs, std::vector<StageTime>* times);

}  // namespace mgsfm
