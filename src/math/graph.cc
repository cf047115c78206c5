// SPDX-License-Identifier: BSD-3-Clause
#include "math/graph.h"

#include "math/union_find.h"

namespace mgsfm {

ConnectedComponents FindConnectedComponents(
    int num_nodes, const std::vector<GraphEdge>& edges) {
  UnionFind sets(num_nodes);
  for (const GraphEdge& edge : edges) sets.Union(edge.node1, edge.node2);
  ConnectedComponents parts;
  parts.component.resize(num_nodes);
  std::vector<int> part_of_root(num_nodes, -1);
  for (int node = 0; node < num_nodes; ++node) {
    int& part = part_of_root[sets.Find(node)];
    if (part < 0) part = parts.num_components++;
    parts.component[node] = part;
  }
  return parts;
}

}  // namespace mgsfm
