// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "math/graph.h"

namespace mgsfm {

// A partition of a graph into connected parts of similar size that overlap.
//
// The parts are subtrees of the maximum spanning forest, because the forest
// crosses every weak cut of the graph by its strongest edge. Trees are cut
// recursively. A set that is to become m parts of s nodes is cut at an edge
// that leaves about j s nodes on one side, j = 1, ..., m - 1:
//
//   1. the strongest edge within s / 10 of a multiple, or without any
//   2. the edge closest to a multiple, if that is within s / 2.
//
// An edge whose weight is below min_relative_weight times the median of the
// forest is weak and never cut. A set without a suitable edge remains whole.
//
// The parts are distributed over connected components by number of nodes, at
// least one each. Nodes of components below min_num_nodes are in no part.
//
// Overlap. Each cut edge (u, v) adds nodes on the side of u to the part of v,
// and vice versa: u, then repeatedly the node with the strongest edge to those
// added so far. Cost: O(E log E) and O(nodes) for each cut.
struct GraphPartitionOptions {
  int num_parts = 2;
  int num_overlap_nodes = 10;
  int min_num_nodes = 3;
  double min_relative_weight = 0.5;
};

struct GraphPartition {
  std::vector<std::optional<int>> part_of_node;
  // Per part: its nodes and the overlap, ascending. Parts are numbered by their
  // first node.
  std::vector<std::vector<int>> nodes;
};

GraphPartition PartitionGraph(int num_nodes,
                              const std::vector<GraphEdge>& edges,
                              const GraphPartitionOptions& options);

}  // namespace mgsfm
