// SPDX-License-Identifier: BSD-3-Clause
#include "math/spanning_tree.h"

#include <algorithm>

#include "base/ranges.h"
#include "math/item_groups.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

std::vector<int> MaximumSpanningForest(int num_nodes,
                                       const std::vector<GraphEdge>& edges) {
  std::vector<int> order = Indices(edges.size());
  StableSortDescendingBy(&order, [&](int a) { return edges[a].weight; });
  UnionFind sets(num_nodes);
  std::vector<int> forest;
  for (const int e : order) {
    if (sets.Union(edges[e].node1, edges[e].node2)) forest.push_back(e);
  }
  std::sort(forest.begin(), forest.end());
  return forest;
}

std::vector<ForestStep> WalkForest(int num_nodes,
                                   const std::vector<GraphEdge>& edges,
                                   const std::vector<int>& forest) {
  // The edges at each node, in the order of `forest`.
  const auto adjacent = GroupItems<int, int>(num_nodes, [&](const auto& add) {
    for (const int e : forest) {
      add(edges[e].node1, e);
      add(edges[e].node2, e);
    }
  });
  std::vector<int> by_degree = Indices(num_nodes);
  StableSortDescendingBy(&by_degree, [&](int a) { return adjacent.Size(a); });
  Mask visited(num_nodes, false);
  std::vector<ForestStep> steps;
  steps.reserve(num_nodes);
  for (const int root : by_degree) {
    if (visited[root]) continue;
    visited[root] = true;
    size_t next = steps.size();
    steps.push_back({root, std::nullopt});
    for (; next < steps.size(); ++next) {
      const int node = steps[next].node;
      for (const int* e = adjacent.begin(node); e != adjacent.end(node); ++e) {
        const GraphEdge& edge = edges[*e];
        const int other = edge.node1 == node ? edge.node2 : edge.node1;
        if (visited[other]) continue;
        visited[other] = true;
        steps.push_back({other, ParentEdge{node, *e}});
      }
    }
  }
  return steps;
}

TreePathLengths::TreePathLengths(int num_nodes,
                                 const std::vector<GraphEdge>& edges,
                                 const std::vector<double>& lengths)
    : parent_(num_nodes), depth_(num_nodes, 0), length_(num_nodes, 0.0) {
  MGSFM_CHECK_EQ(edges.size(), lengths.size());
  const std::vector<int> forest = MaximumSpanningForest(num_nodes, edges);
  for (const ForestStep& step : WalkForest(num_nodes, edges, forest)) {
    if (!step.from) continue;
    parent_[step.node] = step.from->parent;
    depth_[step.node] = depth_[step.from->parent] + 1;
    length_[step.node] = lengths[step.from->edge];
  }
}

double TreePathLengths::Between(int a, int b) const {
  double length = 0.0;
  while (a != b) {
    if (depth_[a] < depth_[b]) std::swap(a, b);
    if (!parent_[a]) return length;
    length += length_[a];
    a = *parent_[a];
  }
  return length;
}

}  // namespace mgsfm
