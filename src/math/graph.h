// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

namespace mgsfm {

// Undirected graphs on nodes 0 .. num_nodes - 1, given as lists of edges.
// Parallel edges and loops are allowed.

struct GraphEdge {
  int node1 = 0;
  int node2 = 0;
  double weight = 1.0;
};

// Per node: which connected part it is in. Parts are numbered by their first
// node.
struct ConnectedComponents {
  std::vector<int> component;
  int num_components = 0;
};

ConnectedComponents FindConnectedComponents(
    int num_nodes, const std::vector<GraphEdge>& edges);

}  // namespace mgsfm
