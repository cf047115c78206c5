// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/frame_cuts.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "base/random.h"
#include "math/spanning_tree.h"

namespace mgsfm {
namespace {

// Two trees and one frame without edges.
struct RandomGraph {
  static constexpr int kNumFrames = 31;
  std::vector<GraphEdge> edges;
  Random random{5};

  RandomGraph() {
    AddComponent(0, 20);
    AddComponent(20, 30);
  }

  void AddComponent(int begin, int end) {
    const auto any = [&] {
      return begin +
             static_cast<int>(random.Index(static_cast<uint32_t>(end - begin)));
    };
    for (int i = begin + 1; i < end; ++i) {
      const auto num_before = static_cast<uint32_t>(i - begin);
      edges.push_back({i, begin + static_cast<int>(random.Index(num_before)),
                       random.Uniform(1.0, 2.0)});
    }
    for (int i = begin; i < end; ++i) {
      const int a = any(), b = any();
      if (a != b) edges.push_back({a, b, random.Uniform(0.0, 1.5)});
    }
  }
};

// The frames connected to `start` by the forest without one edge.
std::set<int> Side(const std::vector<GraphEdge>& edges, int start,
                   const FrameCuts::Cut& cut) {
  const std::vector<int> forest =
      MaximumSpanningForest(RandomGraph::kNumFrames, edges);
  std::set<int> side = {start};
  for (bool grows = true; grows;) {
    grows = false;
    for (const int e : forest) {
      const int a = edges[e].node1, b = edges[e].node2;
      if (std::minmax(a, b) == std::minmax(cut.frame_below, cut.frame_above)) {
        continue;
      }
      if (side.count(a) != side.count(b)) {
        side.insert({a, b});
        grows = true;
      }
    }
  }
  return side;
}

TEST(FrameCuts, SplitTheMaximumSpanningForest) {
  const RandomGraph graph;
  const FrameCuts cuts(RandomGraph::kNumFrames, graph.edges);
  ASSERT_EQ(cuts.cuts().size(), 19u + 9u);
  for (size_t k = 0; k < cuts.cuts().size(); ++k) {
    const FrameCuts::Cut& cut = cuts.cuts()[k];
    const std::set<int> below = Side(graph.edges, cut.frame_below, cut);
    const std::set<int> above = Side(graph.edges, cut.frame_above, cut);
    EXPECT_THAT(cuts.FramesOfSide(k, true), testing::ElementsAreArray(below));
    EXPECT_THAT(cuts.FramesOfSide(k, false), testing::ElementsAreArray(above));
    EXPECT_TRUE(cuts.CoreIsAbove(k) ? below.size() <= above.size()
                                    : below.size() >= above.size());
  }
}

TEST(FrameCuts, SumWhatCrossesThem) {
  RandomGraph graph;
  const FrameCuts cuts(RandomGraph::kNumFrames, graph.edges);
  FrameCuts::Sums pairs(cuts), groups(cuts);
  std::vector<double> expected_pairs(cuts.cuts().size(), 0.0);
  std::vector<double> expected_groups(cuts.cuts().size(), 0.0);
  for (int n = 0; n < 50; ++n) {
    const auto amount = static_cast<double>(graph.random.Index(9));
    std::vector<int> group;
    for (int i = 0; i < 4; ++i) {
      group.push_back(static_cast<int>(graph.random.Index(20)));
    }
    pairs.Add(group[0], group[1], amount);
    pairs.Add(group[0], 25, amount);  // in another tree
    groups.AddGroup(group, amount);
    for (size_t k = 0; k < cuts.cuts().size(); ++k) {
      const std::vector<int> below = cuts.FramesOfSide(k, true);
      const auto is_below = [&](int frame) {
        return std::binary_search(below.begin(), below.end(), frame);
      };
      const auto num_below =
          std::count_if(group.begin(), group.end(), is_below);
      if (is_below(group[0]) != is_below(group[1])) expected_pairs[k] += amount;
      if (num_below > 0 && num_below < 4) expected_groups[k] += amount;
    }
  }
  EXPECT_EQ(pairs.Finish(), expected_pairs);
  EXPECT_EQ(groups.Finish(), expected_groups);
}

TEST(FrameCuts, AreTiedByTwoFramesOnEitherSide) {
  RandomGraph graph;
  const FrameCuts cuts(RandomGraph::kNumFrames, graph.edges);
  FrameCuts::Sums ties(cuts);
  std::vector<double> expected(cuts.cuts().size(), 0.0);
  for (int n = 0; n < 200; ++n) {
    std::set<int> group;
    const uint32_t size = 1 + graph.random.Index(9);
    while (group.size() < size) {
      group.insert(static_cast<int>(graph.random.Index(20)));
    }
    ties.AddTies({group.begin(), group.end()}, 1.0);
    for (size_t k = 0; k < cuts.cuts().size(); ++k) {
      size_t num_below = 0;
      for (const int frame : cuts.FramesOfSide(k, true)) {
        num_below += group.count(frame);
      }
      if (num_below >= 2 && num_below + 2 <= size) ++expected[k];
    }
  }
  EXPECT_EQ(ties.Finish(), expected);
}

TEST(FrameCuts, PassTheSmallestValueOutwards) {
  RandomGraph graph;
  const FrameCuts cuts(RandomGraph::kNumFrames, graph.edges);
  std::vector<double> values;
  for (size_t k = 0; k < cuts.cuts().size(); ++k) {
    values.push_back(graph.random.Uniform());
  }
  // A cut separates the frames of the side without the core from it.
  std::vector<double> expected(RandomGraph::kNumFrames, 1.0);
  for (size_t k = 0; k < values.size(); ++k) {
    for (const int frame : cuts.FramesOfSide(k, cuts.CoreIsAbove(k))) {
      expected[frame] = std::min(expected[frame], values[k]);
    }
  }
  EXPECT_EQ(cuts.SmallestToCore(values), expected);
}

}  // namespace
}  // namespace mgsfm
