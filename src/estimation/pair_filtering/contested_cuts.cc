// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/contested_cuts.h"

#include <cstddef>
#include <vector>

#include "math/union_find.h"
#include "pair_filtering/revisits.h"

namespace mgsfm {
namespace {

// Sets of frames.
struct FrameSets {
  UnionFind parts;      // connected by pairs of neighbors that are used
  UnionFind contested;  // and by those that contradict the motion of the rig
  UnionFind ordered;    // parts that follow each other in time
};

FrameSets FindSets(const FramePairIndex& index, const Mask& is_used,
                   const Mask& pair_is_discontinuous) {
  UnionFind parts(index.num_frames());
  for (size_t i = 0; i < is_used.size(); ++i) {
    const auto& frames = index.Of(i);
    if (is_used[i] && !index.IsLoop(frames)) {
      parts.Union(frames.frame_idx1, frames.frame_idx2);
    }
  }
  FrameSets sets{parts, parts, parts};
  for (size_t i = 0; i < is_used.size(); ++i) {
    if (!pair_is_discontinuous[i]) continue;
    sets.contested.Union(index.Of(i).frame_idx1, index.Of(i).frame_idx2);
  }
  for (const std::vector<int>& sequence : index.order()->sequences()) {
    for (size_t k = 0; k + 1 < sequence.size(); ++k) {
      if (index.order()->IsAfterBreak(sequence[k + 1])) continue;
      sets.ordered.Union(sequence[k], sequence[k + 1]);
    }
  }
  return sets;
}

}  // namespace

Mask FindLoopsAcrossContestedCuts(const FramePairIndex& index,
                                  const Mask& is_used,
                                  const Mask& pair_is_discontinuous,
                                  const Mask& loop_contradicts_motion) {
  Mask is_loop_across(is_used.size(), false);
  if (!index.is_sequence() ||
      (!pair_is_discontinuous.Any() && !loop_contradicts_motion.Any())) {
    return is_loop_across;
  }
  FrameSets sets = FindSets(index, is_used, pair_is_discontinuous);
  const Mask is_revisit = FindRevisits(index, is_used);
  for (size_t i = 0; i < is_used.size(); ++i) {
    const auto& frames = index.Of(i);
    const auto joins = [&](UnionFind& set) {
      return set.Find(frames.frame_idx1) == set.Find(frames.frame_idx2);
    };
    if (!is_used[i] || !index.IsLoop(frames) || joins(sets.parts)) continue;
    is_loop_across[i] =
        (!is_revisit[i] && (joins(sets.contested) || joins(sets.ordered))) ||
        (!loop_contradicts_motion.empty() && loop_contradicts_motion[i]);
  }
  return is_loop_across;
}

}  // namespace mgsfm
