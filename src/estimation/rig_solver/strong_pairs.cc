// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/strong_pairs.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <tuple>

namespace mgsfm {

StrongPairs::StrongPairs(const std::vector<WeightedPair>& pairs, int num_blocks,
                         int num_kept)
    : neighbors_(num_blocks) {
  struct Neighbor {
    int block;
    int weight;
  };
  std::vector<std::vector<Neighbor>> all(num_blocks);
  for (const WeightedPair& pair : pairs) {
    const int a = pair.column, b = pair.row;
    all[a].push_back({b, pair.weight});
    all[b].push_back({a, pair.weight});
  }
  for (int a = 0; a < num_blocks; ++a) {
    const auto key = [a](const Neighbor& n) {
      return std::make_tuple(-n.weight, std::abs(n.block - a), n.block);
    };
    std::sort(
        all[a].begin(), all[a].end(),
        [&](const Neighbor& m, const Neighbor& n) { return key(m) < key(n); });
    for (size_t i = 0; i < all[a].size(); ++i) {
      const auto [b, weight] = all[a][i];
      if (i >= static_cast<size_t>(num_kept) && weight != kInfiniteWeight) {
        break;
      }
      neighbors_[a].push_back(b);
      neighbors_[b].push_back(a);
    }
  }
  for (std::vector<int>& blocks : neighbors_) {
    std::sort(blocks.begin(), blocks.end());
    blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  }
}

bool StrongPairs::Contains(int a, int b) const {
  return a == b ||
         std::binary_search(neighbors_[a].begin(), neighbors_[a].end(), b);
}

}  // namespace mgsfm
