// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

namespace mgsfm {

// Undirected graphs are lists of edges between the nodes 0 .. num_nodes - 1.
// Parallel edges and self-loops are allowed.

struct GraphEdge {
  int node1 = 0;
  int node2 = 0;
  double weight = 1.0;
};

// The connected component of each node. Components are numbered in the order of
// their first nodes.
struct ConnectedComponents {
  std::vector<int> component;
  int num_components = 0;
};

ConnectedComponents FindConnectedComponents(
    int num_nodes, const std::vector<GraphEdge>& edges);

}  // namespace mgsfm
