// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <vector>

#include "least_squares/block_pattern.h"

namespace mgsfm {

// How much ties two blocks together, as the number of points they share.
struct WeightedPair {
  BlockPairKey pair = 0;
  int weight = 0;
};

// Of a pair that has to stay.
constexpr int kInfiniteWeight = std::numeric_limits<int>::max();

// The strongest pairs of a graph of blocks: of each block, those with the
// `num_kept` neighbours of the largest weights, the closest numbers first where
// weights are equal; and all of infinite weight. O(n log n) in the pairs.
class StrongPairs {
 public:
  // `pairs` are sorted, each once, without those of a block with itself.
  StrongPairs(const std::vector<WeightedPair>& pairs, int num_blocks,
              int num_kept);

  // Whether two blocks are the same or a strong pair. O(log num_kept).
  bool Contains(int a, int b) const;

 private:
  std::vector<std::vector<int>> neighbours_;  // of each block, ascending
};

}  // namespace mgsfm
