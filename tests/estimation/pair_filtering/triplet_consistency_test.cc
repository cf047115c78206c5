// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/triplet_consistency.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <tuple>

#include "base/random.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

Mask All(const ViewGraph& view_graph) {
  return Mask(view_graph.pairs.size(), true);
}

// Many random matches of few keypoints; a keypoint can have several.
ViewGraph RandomViewGraph(int num_images, uint32_t num_keypoints,
                          int num_matches) {
  Random random(7);
  ViewGraph view_graph;
  for (int i = 0; i < num_images; ++i) {
    for (int j = i + 1; j < num_images; ++j) {
      ImagePair pair;
      pair.image_idx1 = i;
      pair.image_idx2 = j;
      for (int k = 0; k < num_matches; ++k) {
        pair.matches.push_back(
            {random.Index(num_keypoints), random.Index(num_keypoints)});
      }
      view_graph.pairs.push_back(pair);
    }
  }
  return view_graph;
}

std::vector<int> CountByTryingAll(const ViewGraph& view_graph,
                                  const Mask& pair_is_used, int num_images,
                                  int num_keypoints) {
  using Keypoint = std::pair<int, uint32_t>;  // image, index
  std::set<std::pair<Keypoint, Keypoint>> matched;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair_is_used[i]) continue;
    for (const Match& match : pair.matches) {
      const Keypoint a{pair.image_idx1, match.keypoint_idx1};
      const Keypoint b{pair.image_idx2, match.keypoint_idx2};
      matched.insert({a, b});
      matched.insert({b, a});
    }
  }
  const auto is_triplet_consistent = [&](const Keypoint& a, const Keypoint& b) {
    for (int image = 0; image < num_images; ++image) {
      for (int k = 0; k < num_keypoints; ++k) {
        const Keypoint c{image, static_cast<uint32_t>(k)};
        if (matched.count({a, c}) > 0 && matched.count({b, c}) > 0) return true;
      }
    }
    return false;
  };
  std::vector<int> num_triplet_consistent(view_graph.pairs.size(), 0);
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair_is_used[i]) continue;
    for (const Match& match : pair.matches) {
      num_triplet_consistent[i] +=
          is_triplet_consistent({pair.image_idx1, match.keypoint_idx1},
                                {pair.image_idx2, match.keypoint_idx2});
    }
  }
  return num_triplet_consistent;
}

std::vector<PairMatches> MatchesOf(const ViewGraph& view_graph) {
  std::vector<PairMatches> pairs;
  for (const ImagePair& pair : view_graph.pairs) {
    pairs.push_back({pair.image_idx1, pair.image_idx2, pair.matches});
  }
  return pairs;
}

TEST(TripletConsistency, AgreesWithTryingAllKeypoints) {
  constexpr int kNumImages = 6, kNumKeypoints = 12;
  const ViewGraph view_graph = RandomViewGraph(kNumImages, kNumKeypoints, 12);
  Mask is_used = All(view_graph);
  for (int round = 0; round < 2; ++round) {
    const std::vector<int> expected =
        CountByTryingAll(view_graph, is_used, kNumImages, kNumKeypoints);
    EXPECT_EQ(CountTripletConsistentMatches(view_graph, is_used), expected);
    // The test is only meaningful if some but not all are consistent.
    EXPECT_GT(*std::max_element(expected.begin(), expected.end()), 0);
    EXPECT_LT(*std::max_element(expected.begin(), expected.end()), 12);
    for (size_t i = 0; i < is_used.size(); i += 4) is_used[i] = false;
  }
}

TEST(TripletConsistency, TellsTrueFromIsolatedWrongPairs) {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.max_num_features_per_image = 200;
  options.isolated_wrong_pair_ratio = 0.1;
  options.missing_image_ratio = 0.5;
  const Simulation simulation = Simulate(options);
  const std::vector<int> num_triplet_consistent = CountTripletConsistentMatches(
      simulation.view_graph, All(simulation.view_graph));
  size_t num_wrong = 0, num_matches = 0, num_of_true = 0;
  for (size_t i = 0; i < num_triplet_consistent.size(); ++i) {
    const size_t num = simulation.view_graph.pairs[i].matches.size();
    if (simulation.pair_kinds[i] == PairKind::kIsolatedWrong) {
      ++num_wrong;
      EXPECT_LT(num_triplet_consistent[i], 0.1 * static_cast<double>(num));
    } else {
      num_matches += num;
      num_of_true += num_triplet_consistent[i];
    }
  }
  EXPECT_GT(num_wrong, 3u);
  EXPECT_GT(num_of_true, num_matches / 2);
}

TEST(TripletConsistency, NoPairsNoMatches) {
  EXPECT_TRUE(CountTripletConsistentMatches({}, Mask()).empty());
  std::vector<PairMatches> none;
  EXPECT_TRUE(CountTripletConsistentMatches(&none, Context()).empty());
}

// Some images are not matched, some keypoints several times.
TEST(TripletConsistency, TrianglesOfImagesHaveTheSameTriplets) {
  constexpr int kNumImages = 8, kNumKeypoints = 12;
  ViewGraph view_graph = RandomViewGraph(kNumImages, kNumKeypoints, 12);
  for (int round = 0; round < 3; ++round) {
    const std::vector<int> expected = CountByTryingAll(
        view_graph, All(view_graph), kNumImages, kNumKeypoints);
    std::vector<PairMatches> pairs = MatchesOf(view_graph);
    EXPECT_EQ(CountTripletConsistentMatches(&pairs, Context()), expected);
    for (size_t i = round; i < view_graph.pairs.size(); i += 5) {
      view_graph.pairs.erase(view_graph.pairs.begin() + i);
    }
  }
}

TEST(TripletConsistency, TrianglesOfSimulatedImagesHaveTheSameTriplets) {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.max_num_features_per_image = 200;
  options.mismatch_ratio = 0.2;
  options.missing_image_ratio = 0.2;
  const ViewGraph view_graph = Simulate(options).view_graph;
  std::vector<PairMatches> pairs = MatchesOf(view_graph);
  EXPECT_EQ(CountTripletConsistentMatches(&pairs, Context()),
            CountTripletConsistentMatches(view_graph, All(view_graph)));
}

TEST(TripletConsistency, ThreadsDoNotMatter) {
  // More pairs than one thread takes at a time.
  const ViewGraph view_graph = RandomViewGraph(40, 12, 3);
  const Mask is_used = All(view_graph);
  const Mask one = FindTripletConsistentMatches(view_graph, is_used, 1);
  EXPECT_EQ(FindTripletConsistentMatches(view_graph, is_used, 3), one);
  EXPECT_GT(std::count(one.begin(), one.end(), true), 0);
  EXPECT_GT(std::count(one.begin(), one.end(), false), 0);
}

}  // namespace
}  // namespace mgsfm
