// SPDX-License-Identifier: BSD-3-Clause
#include "tracks/match_bridges.h"

#include <gtest/gtest.h>

#include <set>
#include <tuple>
#include <vector>

#include "mgsfm/base/random.h"
#include "mgsfm/math/union_find.h"

namespace mgsfm::internal {
namespace {

constexpr int kNumKeypoints = 6;

Scene MakeScene(int num_images) {
  Scene scene;
  scene.images.resize(num_images, Image{ImageId(1), "", 0, 0, 0, {}});
  for (Image& image : scene.images) {
    image.keypoints_px.resize(kNumKeypoints);
  }
  return scene;
}

ViewGraph MakeRandomGraph(int num_images, uint32_t num_matches,
                          Random* random) {
  ViewGraph view_graph;
  for (int i = 0; i < num_images; ++i) {
    for (int j = i + 1; j < num_images; ++j) {
      ImagePair pair;
      pair.image_idx1 = i;
      pair.image_idx2 = j;
      view_graph.pairs.push_back(pair);
    }
  }
  std::set<std::tuple<size_t, uint32_t, uint32_t>> matches;
  for (uint32_t k = 0; k < num_matches; ++k) {
    matches.emplace(
        random->Index(static_cast<uint32_t>(view_graph.pairs.size())),
        random->Index(kNumKeypoints), random->Index(kNumKeypoints));
  }
  for (const auto& [pair, keypoint1, keypoint2] : matches) {
    view_graph.pairs[pair].matches.push_back({keypoint1, keypoint2});
  }
  return view_graph;
}

size_t NumParts(const KeypointNodes& nodes, const ViewGraph& view_graph,
                const MatchSelection& selection, uint32_t left_out) {
  UnionFind sets(nodes.size());
  size_t num_parts = nodes.size();
  ForEachMatch(nodes, view_graph, selection, [&](const UsedMatch& match) {
    if (match.position == left_out) return;
    num_parts -= sets.Union(match.node1, match.node2);
  });
  return num_parts;
}

// A match is a bridge if and only if there are more parts without it.
TEST(MatchBridgesTest, AreThoseWithoutWhichThereAreMoreParts) {
  int num_bridges = 0, num_others = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    Random random(3, seed);
    const int num_images = 2 + static_cast<int>(random.Index(6));
    const Scene scene = MakeScene(num_images);
    const ViewGraph view_graph =
        MakeRandomGraph(num_images, 4 + random.Index(50), &random);
    MatchSelection selection;
    for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
      selection.pair_is_used.push_back(random.Uniform() < 0.8);
    }
    const size_t num_matches = NumMatches(view_graph);
    if (seed % 2 == 0) {
      for (size_t k = 0; k < num_matches; ++k) {
        selection.match_is_used.push_back(random.Uniform() < 0.9);
      }
    }
    const KeypointNodes nodes(scene);
    const std::vector<char> is_bridge =
        FindBridges(nodes, view_graph, selection);
    ASSERT_EQ(is_bridge.size(), num_matches);
    const size_t num_parts = NumParts(nodes, view_graph, selection, UINT32_MAX);
    for (uint32_t k = 0; k < num_matches; ++k) {
      const bool expected =
          NumParts(nodes, view_graph, selection, k) > num_parts;
      EXPECT_EQ(is_bridge[k] != 0, expected)
          << "seed " << seed << " match " << k;
      ++(expected ? num_bridges : num_others);
    }
  }
  EXPECT_GT(num_bridges, 100);
  EXPECT_GT(num_others, 100);
}

TEST(MatchBridgesTest, LongChainNeedsNoRecursion) {
  constexpr int kNumImages = 200000;
  const Scene scene = MakeScene(kNumImages);
  ViewGraph view_graph;
  for (int i = 1; i < kNumImages; ++i) {
    ImagePair pair;
    pair.image_idx1 = i - 1;
    pair.image_idx2 = i;
    pair.matches.push_back({0, 0});
    view_graph.pairs.push_back(pair);
  }
  const std::vector<char> is_bridge =
      FindBridges(KeypointNodes(scene), view_graph,
                  {std::vector<char>(view_graph.pairs.size(), true), {}});
  EXPECT_EQ(is_bridge, std::vector<char>(kNumImages - 1, true));
}

}  // namespace
}  // namespace mgsfm::internal
