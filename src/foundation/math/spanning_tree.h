// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "math/graph.h"

namespace mgsfm {

// The edge of a spanning forest that connects a node to its parent.
struct ParentEdge {
  int parent = 0;
  int edge = 0;  // index into the list of edges
};

// One step of a traversal of a forest. Parents precede their children.
struct ForestStep {
  int node = 0;
  std::optional<ParentEdge> from;  // nullopt for roots
};

// Indices of the edges of a spanning forest of maximum total weight, in
// ascending order (Kruskal, O(E log E)). Ties are broken by the order of the
// list, so the result is unique.
std::vector<int> MaximumSpanningForest(int num_nodes,
                                       const std::vector<GraphEdge>& edges);

// All nodes in breadth-first order over the edges with indices `forest`. The
// root of a tree is its node of highest degree; ties go to the first node.
std::vector<ForestStep> WalkForest(int num_nodes,
                                   const std::vector<GraphEdge>& edges,
                                   const std::vector<int>& forest);

// Path lengths in the maximum spanning forest of a graph whose edges have
// lengths.
class TreePathLengths {
 public:
  TreePathLengths(int num_nodes, const std::vector<GraphEdge>& edges,
                  const std::vector<double>& lengths);

  // The length of the path from a to b. For nodes of different trees, the sum
  // of the path lengths from each node to its root. O(path edges).
  double Between(int a, int b) const;

 private:
  std::vector<std::optional<int>> parent_;  // nullopt for roots
  std::vector<int> depth_;
  std::vector<double> length_;  // of the edge to the parent
};

}  // namespace mgsfm
