// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace mgsfm {

// The sorted neighbors of each node of an undirected graph in flat arrays.
class SortedAdjacency {
 public:
  // for_each_edge(visit) calls visit(node1, node2) for all edges. It is called
  // twice and must visit the same edges.
  template <class ForEachEdge>
  SortedAdjacency(size_t num_nodes, const ForEachEdge& for_each_edge)
      : offsets_(num_nodes + 1, 0) {
    for_each_edge([&](uint32_t node1, uint32_t node2) {
      ++offsets_[node1 + 1];
      ++offsets_[node2 + 1];
    });
    std::partial_sum(offsets_.begin(), offsets_.end(), offsets_.begin());
    neighbors_.resize(offsets_.back());
    std::vector<size_t> next(offsets_.begin(), offsets_.end() - 1);
    for_each_edge([&](uint32_t node1, uint32_t node2) {
      neighbors_[next[node1]++] = node2;
      neighbors_[next[node2]++] = node1;
    });
    for (size_t node = 0; node < num_nodes; ++node) {
      std::sort(neighbors_.begin() + offsets_[node],
                neighbors_.begin() + offsets_[node + 1]);
    }
  }

  const uint32_t* begin(uint32_t node) const {
    return neighbors_.data() + offsets_[node];
  }
  const uint32_t* end(uint32_t node) const {
    return neighbors_.data() + offsets_[node + 1];
  }

  // The number of common neighbors of a and b. Counting stops at `enough`.
  uint32_t NumCommonNeighbors(uint32_t a, uint32_t b,
                              uint32_t enough = UINT32_MAX) const {
    uint32_t num_common = 0;
    const uint32_t *i = begin(a), *j = begin(b);
    while (i != end(a) && j != end(b) && num_common < enough) {
      if (*i == *j) {
        ++num_common;
        ++i;
        ++j;
      } else {
        *i < *j ? ++i : ++j;
      }
    }
    return num_common;
  }

 private:
  std::vector<size_t> offsets_;
  std::vector<uint32_t> neighbors_;
};

}  // namespace mgsfm
