// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace mgsfm {

// Calls visit(ab, ac, bc) with the positions of the edges of each triangle of
// nodes a < b < c. Edges have the smaller node first and are sorted. Triangles
// follow the order of their edges ab, then ac.
template <class Visitor>
void ForEachTriangle(const std::vector<std::pair<int, int>>& edges,
                     const Visitor& visit) {
  for (size_t ab = 0; ab < edges.size(); ++ab) {
    const auto [a, b] = edges[ab];
    auto bc = std::lower_bound(edges.begin(), edges.end(), std::pair(b, 0));
    for (size_t ac = ab + 1; ac < edges.size() && edges[ac].first == a; ++ac) {
      const std::pair<int, int> wanted(b, edges[ac].second);
      while (bc != edges.end() && *bc < wanted) ++bc;
      if (bc == edges.end()) break;
      if (*bc == wanted) visit(ab, ac, static_cast<size_t>(bc - edges.begin()));
    }
  }
}

}  // namespace mgsfm
