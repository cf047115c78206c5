// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "math/item_groups.h"

namespace mgsfm {

// The sorted neighbors of each node of an undirected graph in flat arrays.
class SortedAdjacency {
 public:
  // for_each_edge(visit) calls visit(node1, node2) for all edges. It is called
  // twice and must visit the same edges.
  template <class ForEachEdge>
  SortedAdjacency(size_t num_nodes, const ForEachEdge& for_each_edge)
      : neighbors_(GroupItems<uint32_t>(num_nodes, [&](const auto& add) {
          for_each_edge([&](uint32_t node1, uint32_t node2) {
            add(node1, node2);
            add(node2, node1);
          });
        })) {
    const auto begin = neighbors_.items.begin();
    for (size_t node = 0; node < num_nodes; ++node) {
      std::sort(begin + neighbors_.offsets[node],
                begin + neighbors_.offsets[node + 1]);
    }
  }

  const uint32_t* begin(uint32_t node) const { return neighbors_.begin(node); }
  const uint32_t* end(uint32_t node) const { return neighbors_.end(node); }

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
  ItemGroups<uint32_t> neighbors_;
};

}  // namespace mgsfm
