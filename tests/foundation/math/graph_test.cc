// SPDX-License-Identifier: BSD-3-Clause
#include "math/graph.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "base/random.h"
#include "math/spanning_tree.h"
#include "math/union_find.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;

TEST(UnionFind, JoinsSets) {
  UnionFind sets(5);
  EXPECT_TRUE(sets.Union(0, 3));
  EXPECT_TRUE(sets.Union(3, 4));
  EXPECT_FALSE(sets.Union(0, 4));
  EXPECT_EQ(sets.Find(0), sets.Find(4));
  EXPECT_NE(sets.Find(0), sets.Find(1));
  EXPECT_EQ(sets.SetSize(4), 3u);
  EXPECT_EQ(sets.SetSize(2), 1u);
}

TEST(UnionFind, LongChainNeedsNoRecursion) {
  constexpr size_t kSize = 1000000;
  UnionFind sets(kSize);
  for (size_t i = 1; i < kSize; ++i) sets.Union(i - 1, i);
  EXPECT_EQ(sets.SetSize(0), kSize);
}

TEST(ConnectedComponents, AreNumberedByFirstNode) {
  const ConnectedComponents parts =
      FindConnectedComponents(6, {{5, 1}, {2, 4}, {4, 2}});
  EXPECT_THAT(parts.component, ElementsAre(0, 1, 2, 3, 2, 1));
  EXPECT_EQ(parts.num_components, 4);
}

TEST(ConnectedComponents, EmptyGraph) {
  EXPECT_EQ(FindConnectedComponents(0, {}).num_components, 0);
  EXPECT_TRUE(MaximumSpanningForest(0, {}).empty());
  EXPECT_TRUE(WalkForest(0, {}, {}).empty());
}

double WeightOf(const std::vector<GraphEdge>& edges,
                const std::vector<int>& chosen) {
  double weight = 0.0;
  for (const int e : chosen) weight += edges[e].weight;
  return weight;
}

// The maximum weight of all spanning trees, by enumeration of edge subsets.
double BruteForceTreeWeight(int num_nodes,
                            const std::vector<GraphEdge>& edges) {
  double best = -1.0;
  for (unsigned subset = 0; subset < (1u << edges.size()); ++subset) {
    std::vector<GraphEdge> chosen;
    double weight = 0.0;
    for (size_t e = 0; e < edges.size(); ++e) {
      if ((subset >> e & 1u) == 0) continue;
      chosen.push_back(edges[e]);
      weight += edges[e].weight;
    }
    if (static_cast<int>(chosen.size()) == num_nodes - 1 &&
        FindConnectedComponents(num_nodes, chosen).num_components == 1) {
      best = std::max(best, weight);
    }
  }
  return best;
}

TEST(MaximumSpanningForest, IsOptimal) {
  Random random(3);
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<GraphEdge> edges;
    for (int node = 1; node < 5; ++node) {
      edges.push_back({static_cast<int>(random.Index(node)), node,
                       random.Uniform(0.0, 10.0)});
    }
    for (int i = 0; i < 6; ++i) {
      edges.push_back({static_cast<int>(random.Index(5)),
                       static_cast<int>(random.Index(5)),
                       random.Uniform(0.0, 10.0)});
    }
    const std::vector<int> forest = MaximumSpanningForest(5, edges);
    EXPECT_EQ(forest.size(), 4u);
    EXPECT_NEAR(WeightOf(edges, forest), BruteForceTreeWeight(5, edges), 1e-12);
  }
}

TEST(MaximumSpanningForest, PrefersFirstOfEqualEdges) {
  EXPECT_THAT(MaximumSpanningForest(3, {{0, 1}, {1, 2}, {2, 0}, {1, 0}}),
              ElementsAre(0, 1));
}

TEST(WalkForest, VisitsParentsFirst) {
  const std::vector<GraphEdge> edges = {{4, 3}, {0, 1}, {1, 2}, {3, 1}};
  const std::vector<ForestStep> steps =
      WalkForest(6, edges, MaximumSpanningForest(6, edges));
  ASSERT_EQ(steps.size(), 6u);
  EXPECT_EQ(steps[0].node, 1);  // most neighbors
  Mask visited(6, false);
  int num_roots = 0;
  for (const ForestStep& step : steps) {
    EXPECT_FALSE(visited[step.node]);
    visited[step.node] = 1;
    if (!step.from) {
      ++num_roots;
      continue;
    }
    EXPECT_TRUE(visited[step.from->parent]);
    const GraphEdge& edge = edges[step.from->edge];
    EXPECT_EQ(edge.node1 + edge.node2, step.node + step.from->parent);
  }
  EXPECT_EQ(num_roots, 2);
}

TEST(TreePathLengths, AreThoseAlongTheForest) {
  constexpr int kNumNodes = 30;
  Random random(5);
  std::vector<GraphEdge> edges;
  std::vector<double> lengths;
  for (int e = 0; e < 45; ++e) {
    edges.push_back({static_cast<int>(random.Index(kNumNodes)),
                     static_cast<int>(random.Index(kNumNodes)),
                     random.Uniform()});
    lengths.push_back(random.Uniform(1.0, 2.0));
  }
  const double infinity = std::numeric_limits<double>::infinity();
  std::vector<std::vector<double>> expected(
      kNumNodes, std::vector<double>(kNumNodes, infinity));
  for (int i = 0; i < kNumNodes; ++i) expected[i][i] = 0.0;
  for (const int e : MaximumSpanningForest(kNumNodes, edges)) {
    expected[edges[e].node1][edges[e].node2] = lengths[e];
    expected[edges[e].node2][edges[e].node1] = lengths[e];
  }
  for (int k = 0; k < kNumNodes; ++k) {
    for (int i = 0; i < kNumNodes; ++i) {
      for (int j = 0; j < kNumNodes; ++j) {
        expected[i][j] =
            std::min(expected[i][j], expected[i][k] + expected[k][j]);
      }
    }
  }
  const TreePathLengths path_lengths(kNumNodes, edges, lengths);
  for (int i = 0; i < kNumNodes; ++i) {
    for (int j = 0; j < kNumNodes; ++j) {
      if (expected[i][j] == infinity) continue;
      EXPECT_NEAR(path_lengths.Between(i, j), expected[i][j], 1e-12);
    }
  }
}

}  // namespace
}  // namespace mgsfm
