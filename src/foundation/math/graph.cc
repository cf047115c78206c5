// SPDX-License-Identifier: BSD-3-Clause
#include "math/graph.h"

#include <optional>

#include "math/union_find.h"

namespace mgsfm {

ConnectedComponents FindConnectedComponents(
    int num_nodes, const std::vector<GraphEdge>& edges) {
  UnionFind sets(num_nodes);
  for (const GraphEdge& edge : edges) sets.Union(edge.node1, edge.node2);
  ConnectedComponents components;
  components.component.resize(num_nodes);
  std::vector<std::optional<int>> component_of_root(num_nodes);
  for (int node = 0; node < num_nodes; ++node) {
    std::optional<int>& component = component_of_root[sets.Find(node)];
    if (!component) component = components.num_components++;
    components.component[node] = *component;
  }
  return components;
}

}  // namespace mgsfm
