// SPDX-License-Identifier: BSD-3-Clause
#include "math/graph_partition.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "base/random.h"

namespace mgsfm {
namespace {

// A chain in which neighbors up to three apart are connected, the closer the
// stronger.
std::vector<GraphEdge> Chain(int num_nodes, uint64_t seed = 0) {
  Random random(seed);
  std::vector<GraphEdge> edges;
  for (int i = 0; i < num_nodes; ++i) {
    for (int gap = 1; gap <= 3 && i + gap < num_nodes; ++gap) {
      edges.push_back({i, i + gap, random.Uniform(80.0, 120.0) / gap});
    }
  }
  return edges;
}

std::vector<int> SizesOf(const GraphPartition& partition) {
  std::vector<int> sizes(partition.nodes.size(), 0);
  for (const auto& part : partition.part_of_node) {
    if (part) ++sizes[*part];
  }
  return sizes;
}

// Whether the edges within the nodes connect all of them.
bool AreConnected(const std::vector<int>& nodes, int num_nodes,
                  const std::vector<GraphEdge>& edges) {
  const std::set<int> in_part(nodes.begin(), nodes.end());
  std::vector<GraphEdge> inside;
  for (const GraphEdge& edge : edges) {
    if (in_part.count(edge.node1) + in_part.count(edge.node2) == 2) {
      inside.push_back(edge);
    }
  }
  const ConnectedComponents found = FindConnectedComponents(num_nodes, inside);
  std::set<int> components;
  for (const int node : nodes) components.insert(found.component[node]);
  return components.size() == 1;
}

TEST(GraphPartition, ChainIsCutIntoEqualConnectedPartsThatOverlap) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    const std::vector<GraphEdge> edges = Chain(800, seed);
    GraphPartitionOptions options;
    options.num_parts = 8;
    const GraphPartition partition = PartitionGraph(800, edges, options);
    ASSERT_EQ(partition.nodes.size(), 8u);
    for (const int size : SizesOf(partition)) {
      EXPECT_NEAR(size, 100, 21);  // two cuts, each off by a tenth
    }
    for (size_t i = 0; i < partition.nodes.size(); ++i) {
      EXPECT_TRUE(AreConnected(partition.nodes[i], 800, edges));
      if (i == 0) continue;
      std::vector<int> common;
      std::set_intersection(
          partition.nodes[i - 1].begin(), partition.nodes[i - 1].end(),
          partition.nodes[i].begin(), partition.nodes[i].end(),
          std::back_inserter(common));
      EXPECT_EQ(common.size(), 2u * options.num_overlap_nodes);
    }
  }
}

// Two districts joined by one street: the weak edge stays within a part.
TEST(GraphPartition, NoCutCrossesAWeakEdge) {
  std::vector<GraphEdge> edges;
  for (const GraphEdge& edge : Chain(400)) {
    const bool crosses = edge.node1 < 200 && edge.node2 >= 200;
    if (!crosses) edges.push_back(edge);
  }
  edges.push_back({199, 200, 5.0});
  for (const int num_parts : {2, 3, 4, 7}) {
    GraphPartitionOptions options;
    options.num_parts = num_parts;
    const GraphPartition partition = PartitionGraph(400, edges, options);
    EXPECT_GE(partition.nodes.size(), 2u);
    EXPECT_EQ(partition.part_of_node[199], partition.part_of_node[200]);
  }
}

TEST(GraphPartition, ComponentsGetPartsBySizeAndFragmentsNone) {
  std::vector<GraphEdge> edges = Chain(300);
  for (GraphEdge edge : Chain(100)) {
    edges.push_back({edge.node1 + 300, edge.node2 + 300, edge.weight});
  }
  edges.push_back({400, 401, 100.0});
  GraphPartitionOptions options;
  options.num_parts = 4;
  const GraphPartition partition = PartitionGraph(403, edges, options);
  ASSERT_EQ(partition.nodes.size(), 4u);
  EXPECT_EQ(partition.nodes[3].size(), 100u);
  for (int i = 400; i < 403; ++i) EXPECT_FALSE(partition.part_of_node[i]);
}

TEST(GraphPartition, EmptyGraph) {
  EXPECT_TRUE(PartitionGraph(0, {}, {}).nodes.empty());
}

}  // namespace
}  // namespace mgsfm
