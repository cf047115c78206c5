// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/contested_cuts.h"

#include <cstddef>

#include "math/union_find.h"

namespace mgsfm {

Mask FindLoopsAcrossContestedCuts(const FramePairIndex& index,
                                  const Mask& is_used,
                                  const Mask& pair_is_discontinuous,
                                  const Mask& loop_contradicts_motion) {
  Mask is_loop_across(is_used.size(), false);
  if (!index.is_sequence() ||
      (!pair_is_discontinuous.Any() && !loop_contradicts_motion.Any())) {
    return is_loop_across;
  }
  UnionFind parts(index.num_frames());
  for (size_t i = 0; i < is_used.size(); ++i) {
    const auto& frames = index.Of(i);
    if (is_used[i] && !index.IsLoop(frames)) {
      parts.Union(frames.frame_idx1, frames.frame_idx2);
    }
  }
  UnionFind groups = parts;  // of parts that contested cuts separate
  for (size_t i = 0; i < is_used.size(); ++i) {
    if (!pair_is_discontinuous[i]) continue;
    groups.Union(index.Of(i).frame_idx1, index.Of(i).frame_idx2);
  }
  for (size_t i = 0; i < is_used.size(); ++i) {
    const auto& frames = index.Of(i);
    is_loop_across[i] =
        is_used[i] && index.IsLoop(frames) &&
        parts.Find(frames.frame_idx1) != parts.Find(frames.frame_idx2) &&
        (groups.Find(frames.frame_idx1) == groups.Find(frames.frame_idx2) ||
         (!loop_contradicts_motion.empty() && loop_contradicts_motion[i]));
  }
  return is_loop_across;
}

}  // namespace mgsfm
