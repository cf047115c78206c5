// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/ambiguous_steps.h"

#include <cstddef>
#include <vector>

namespace mgsfm {
namespace {

// If the motion of more steps is ambiguous, the motions are wrong rather than
// ambiguous: those of a mirrored camera, for example. On 132 moderate and hard
// drives, at most 4.5 % are.
constexpr double kMaxAmbiguous = 0.1;

// The frames beside the steps.
Mask FramesBeside(const TemporalOrder& order, const RigPath& path) {
  Mask is_beside(path.of_frame.size(), false);
  int num_steps = 0, num_ambiguous = 0;
  for (const std::vector<int>& sequence : order.sequences()) {
    for (size_t k = 0; k + 1 < sequence.size(); ++k) {
      ++num_steps;
      if (!path.IsAmbiguousBetween(sequence[k], sequence[k + 1])) continue;
      ++num_ambiguous;
      is_beside[sequence[k]] = true;
      is_beside[sequence[k + 1]] = true;
    }
  }
  if (num_ambiguous > kMaxAmbiguous * num_steps) {
    return Mask(is_beside.size(), false);
  }
  return is_beside;
}

}  // namespace

AmbiguousSteps FindAmbiguousSteps(const FramePairIndex& index,
                                  const RigPath& path) {
  AmbiguousSteps steps{Mask(index.num_pairs(), false),
                       FramesBeside(*index.order(), path)};
  if (!steps.frame_is_beside.Any()) return steps;
  for (const FramePairIndex::FramePair& frames : index.frame_pairs()) {
    if (!index.AreNeighbors(frames) ||
        !path.IsAmbiguousBetween(frames.frame_idx1, frames.frame_idx2)) {
      continue;
    }
    for (const size_t i : frames.pair_idxs) steps.pair_is_across[i] = true;
  }
  return steps;
}

}  // namespace mgsfm
