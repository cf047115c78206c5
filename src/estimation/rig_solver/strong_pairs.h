// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <vector>

#include "rig_solver/block_pattern.h"

namespace mgsfm {

// A pair of blocks, weighted by the number of points that they share. There can
// be millions of them.
struct WeightedPair {
  int column = 0;
  int row = 0;
  int weight = 0;

  BlockPairKey Key() const { return MakeBlockPairKey(column, row); }
};

// The weight of pairs that are always kept.
constexpr int kInfiniteWeight = std::numeric_limits<int>::max();

// The strongest edges of a graph of blocks: for each block, those to the
// `num_kept` neighbors with the largest weights, and all of infinite weight.
// Ties prefer neighbors with a close index. O(n log n) in the pairs.
class StrongPairs {
 public:
  // `pairs` are sorted and unique, without diagonal pairs.
  StrongPairs(const std::vector<WeightedPair>& pairs, int num_blocks,
              int num_kept);

  // Whether two blocks are the same or a strong pair. O(log num_kept).
  bool Contains(int a, int b) const;

 private:
  std::vector<std::vector<int>> neighbors_;  // per block, ascending
};

}  // namespace mgsfm
