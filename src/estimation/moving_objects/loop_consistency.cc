// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/loop_consistency.h"

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace mgsfm {
namespace {

// Per frame: the length of the path from the first frame of its sequence.
std::vector<double> LengthsFromStart(const TemporalOrder& order,
                                     const RigPath& path) {
  std::vector<double> lengths(path.of_frame.size(), 0.0);
  for (const std::vector<int>& sequence : order.sequences()) {
    for (size_t k = 1; k < sequence.size(); ++k) {
      const int a = sequence[k - 1], b = sequence[k];
      const double step =
          path.IsComparable(a, b) ? path.Between(a, b).translation.norm() : 0.0;
      lengths[b] = lengths[a] + step;
    }
  }
  return lengths;
}

}  // namespace

Mask FindLoopsAgainstPath(const FramePairIndex& index, const RigPath& path,
                          double max_drift) {
  Mask is_against(index.num_pairs(), false);
  const std::vector<double> lengths = LengthsFromStart(*index.order(), path);
  for (const FramePairIndex::FramePair& frames : index.frame_pairs()) {
    const int a = frames.frame_idx1, b = frames.frame_idx2;
    if (!index.IsLoop(frames) || !path.IsComparable(a, b)) continue;
    const double length = std::abs(lengths[a] - lengths[b]);
    const double reach = index.Reach(frames) * path.noise.median_step;
    if (path.Between(a, b).translation.norm() <= max_drift * length + reach) {
      continue;
    }
    for (const size_t i : frames.pair_idxs) is_against[i] = true;
  }
  return is_against;
}

}  // namespace mgsfm
