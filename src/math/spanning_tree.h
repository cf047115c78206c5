// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "math/graph.h"

namespace mgsfm {

// One step of a walk over a forest: from a node that was visited before to a
// new one along an edge. Roots have neither.
struct ForestStep {
  int node = 0;
  int parent = -1;
  int edge = -1;  // position in the list of edges
};

// Positions of the edges of a spanning forest of maximum total weight, in
// ascending order (Kruskal, O(E log E)). Of edges with equal weight the one
// that comes first in the list is preferred, so the result is unique.
std::vector<int> MaximumSpanningForest(int num_nodes,
                                       const std::vector<GraphEdge>& edges);

// All nodes in breadth-first order over the edges at the positions `forest`,
// each tree from its node with most neighbours (of those the first).
std::vector<ForestStep> WalkForest(int num_nodes,
                                   const std::vector<GraphEdge>& edges,
                                   const std::vector<int>& forest);

// Ways along the spanning forest of maximum weight of edges with lengths.
class ForestWays {
 public:
  ForestWays(int num_nodes, const std::vector<GraphEdge>& edges,
             const std::vector<double>& lengths);

  // The length of the way from a to b; of the parts of it that there are, if
  // they are in different trees. Cost: the number of edges on the way.
  double Between(int a, int b) const;

 private:
  std::vector<int> parent_;  // -1 for roots
  std::vector<int> depth_;
  std::vector<double> way_;  // to the parent
};

}  // namespace mgsfm
