// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mapper/mapper_recipe.h"
#include "mapper/verified_pairs.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Which pairs a model may grow on. Growth registers one frame at a time and
// sees no loop before it closes: pairs of two places that look alike attach the
// frames of one place to the other, and what follows agrees with them.

// Rejects the pairs that positions averaged from pairs alone contradict, per
// component, by the rules on baselines (translation_averaging/
// position_estimation.h). Rotations do not tell parallel streets apart. Without
// loop pairs in a sequence, nothing is rejected. Cost: linear in the pairs.
void RejectByPositions(const MapperRunInput& run, const VerifiedPairs& pairs,
                       const FramePairIndex& index, JudgedPairs* judged,
                       std::vector<StageTime>* times);

// The pairs with an image that the existing model lacks, and a spanning forest
// of the others: those with the most matches of the model's points. The forest
// tells the rules how the frames of the model lie to each other. nullopt if all
// pairs are needed: there is no model, it has no points, or it has all images.
[[nodiscard]] std::optional<ViewGraph> PairsOfNewImages(
    const MapperRunInput& run);

}  // namespace mgsfm
