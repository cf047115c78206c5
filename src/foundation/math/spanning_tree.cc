// SPDX-License-Identifier: BSD-3-Clause
#include "math/spanning_tree.h"

#include <algorithm>
#include <numeric>

#include "base/ranges.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// The edges incident to each node in flat arrays, in the order of `forest`.
struct Adjacency {
  std::vector<int> offsets;
  std::vector<int> edges;

  int Degree(int node) const { return offsets[node + 1] - offsets[node]; }
};

Adjacency BuildAdjacency(int num_nodes, const std::vector<GraphEdge>& edges,
                         const std::vector<int>& forest) {
  Adjacency adjacency;
  adjacency.offsets.assign(num_nodes + 1, 0);
  for (const int e : forest) {
    ++adjacency.offsets[edges[e].node1 + 1];
    ++adjacency.offsets[edges[e].node2 + 1];
  }
  std::partial_sum(adjacency.offsets.begin(), adjacency.offsets.end(),
                   adjacency.offsets.begin());
  adjacency.edges.resize(2 * forest.size());
  std::vector<int> next(adjacency.offsets.begin(), adjacency.offsets.end() - 1);
  for (const int e : forest) {
    adjacency.edges[next[edges[e].node1]++] = e;
    adjacency.edges[next[edges[e].node2]++] = e;
  }
  return adjacency;
}

std::vector<int> NodesByDegree(int num_nodes, const Adjacency& adjacency) {
  std::vector<int> nodes = Indices(num_nodes);
  StableSortDescendingBy(&nodes, [&](int a) { return adjacency.Degree(a); });
  return nodes;
}

}  // namespace

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
  const Adjacency adjacency = BuildAdjacency(num_nodes, edges, forest);
  Mask visited(num_nodes, false);
  std::vector<ForestStep> steps;
  steps.reserve(num_nodes);
  for (const int root : NodesByDegree(num_nodes, adjacency)) {
    if (visited[root]) continue;
    visited[root] = true;
    size_t next = steps.size();
    steps.push_back({root, std::nullopt});
    for (; next < steps.size(); ++next) {
      const int node = steps[next].node;
      for (int i = adjacency.offsets[node]; i < adjacency.offsets[node + 1];
           ++i) {
        const GraphEdge& edge = edges[adjacency.edges[i]];
        const int other = edge.node1 == node ? edge.node2 : edge.node1;
        if (visited[other]) continue;
        visited[other] = true;
        steps.push_back({other, ParentEdge{node, adjacency.edges[i]}});
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
