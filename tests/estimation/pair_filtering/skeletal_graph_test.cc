// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/skeletal_graph.h"

#include <gtest/gtest.h>

#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// Frames in a row, each with one image.
Scene MakeScene(int num_frames) {
  Scene scene;
  for (int i = 0; i < num_frames; ++i) {
    scene.images.push_back(
        {ImageId(static_cast<uint32_t>(i + 1)), "", 0, 0, i, {}});
    scene.frames.push_back({FrameId(static_cast<uint32_t>(i + 1)), "", 0, {i}});
  }
  return scene;
}

// Matches the keypoints begin_point to end_point - 1, which observe the points
// with these numbers.
void AddPair(int image_idx1, int image_idx2, uint32_t begin_point,
             uint32_t end_point, ViewGraph* view_graph) {
  ImagePair pair;
  pair.image_idx1 = image_idx1;
  pair.image_idx2 = image_idx2;
  for (uint32_t point = begin_point; point < end_point; ++point) {
    pair.matches.push_back({point, point});
  }
  view_graph->pairs.push_back(pair);
}

// Matches of points that no other pair observes.
void AddPair(int image_idx1, int image_idx2, uint32_t num_matches,
             ViewGraph* view_graph) {
  const auto begin_point =
      static_cast<uint32_t>(1000 * view_graph->pairs.size());
  AddPair(image_idx1, image_idx2, begin_point, begin_point + num_matches,
          view_graph);
}

Mask Select(const Scene& scene, const ViewGraph& view_graph,
            SequenceMode sequence = SequenceMode::kNo) {
  const FramePairIndex index(scene, view_graph, sequence);
  const Mask all(view_graph.pairs.size(), true);
  const PairFilteringOptions options;
  return SelectSkeletalGraph({scene, index, view_graph, all, options});
}

TEST(SkeletalGraph, ContainsNeighborsAndNoDuplicates) {
  const Scene scene = MakeScene(20);
  ViewGraph view_graph;
  Mask is_neighbor;
  for (int i = 0; i + 1 < 20; ++i) {
    AddPair(i, i + 1, 100, &view_graph);
    is_neighbor.push_back(true);
    if (i + 2 < 20) {
      AddPair(i, i + 2, 50, &view_graph);
      is_neighbor.push_back(false);
    }
    if (i + 10 < 20) {
      AddPair(i, i + 10, 40, &view_graph);
      is_neighbor.push_back(false);
    }
  }
  EXPECT_EQ(Select(scene, view_graph), is_neighbor);
}

TEST(SkeletalGraph, WeakPairsConnectComponents) {
  const Scene scene = MakeScene(6);
  ViewGraph view_graph;
  AddPair(0, 1, 100, &view_graph);
  AddPair(1, 2, 100, &view_graph);
  AddPair(3, 4, 100, &view_graph);
  AddPair(4, 5, 100, &view_graph);
  AddPair(2, 3, 30, &view_graph);
  AddPair(2, 4, 20, &view_graph);  // nearly as strong
  AddPair(0, 5, 10, &view_graph);  // far weaker
  EXPECT_EQ(Select(scene, view_graph),
            (Mask{true, true, true, true, true, true, false}));
}

// A frame that lost images can have more matches with an unrelated place than
// with its neighbors. Only the neighbors have triplet support.
TEST(SkeletalGraph, ManyMatchesWithoutTripletSupportAreNotEnough) {
  const Scene scene = MakeScene(8);
  ViewGraph view_graph;
  const auto add_place = [&](int first, uint32_t begin_point) {
    for (int i = first; i < first + 4; ++i) {
      for (int j = i + 1; j < first + 4; ++j) {
        AddPair(i, j, begin_point, begin_point + 20, &view_graph);
      }
    }
  };
  add_place(0, 0);
  add_place(4, 100);
  AddPair(3, 4, 100, 110, &view_graph);  // a little of the other place
  AddPair(3, 5, 100, 110, &view_graph);
  const size_t num_true = view_graph.pairs.size();
  AddPair(0, 7, 60, &view_graph);
  AddPair(1, 6, 300, 360, &view_graph);
  Mask expected(view_graph.pairs.size(), true);
  for (size_t i = num_true; i < expected.size(); ++i) expected[i] = false;
  EXPECT_EQ(Select(scene, view_graph), expected);
}

TEST(SkeletalGraph, PairsWithoutTripletSupportConnectTheRest) {
  const Scene scene = MakeScene(5);
  ViewGraph view_graph;
  AddPair(0, 1, 0, 50, &view_graph);
  AddPair(0, 2, 0, 50, &view_graph);
  AddPair(1, 2, 0, 50, &view_graph);
  AddPair(2, 3, 60, &view_graph);
  AddPair(1, 3, 20, &view_graph);
  AddPair(3, 4, 30, &view_graph);
  EXPECT_EQ(Select(scene, view_graph),
            (Mask{true, true, true, true, false, true}));
}

TEST(SkeletalGraph, ContainsNoUnusedPairs) {
  const Scene scene = MakeScene(3);
  ViewGraph view_graph;
  AddPair(0, 1, 100, &view_graph);
  AddPair(1, 2, 50, &view_graph);
  const FramePairIndex index(scene, view_graph);
  const Mask second{false, true};
  const PairFilteringOptions options;
  EXPECT_EQ(SelectSkeletalGraph({scene, index, view_graph, second, options}),
            second);
}

// Two stretches of a drive with one weak pair between them. Duplicate
// structures of distant frames support each other by triplets and are much
// stronger.
TEST(SkeletalGraph, NeighborsInTimeDecideWeakCutsOfASequence) {
  const Scene scene = MakeScene(40);
  ViewGraph view_graph;
  const auto add_stretch = [&](int begin, int end) {
    for (int i = begin; i + 1 < end; ++i) AddPair(i, i + 1, 100, &view_graph);
  };
  add_stretch(0, 20);
  add_stretch(20, 40);
  const size_t true_pair = view_graph.pairs.size();
  AddPair(19, 20, 20, &view_graph);
  const size_t first_wrong = view_graph.pairs.size();
  AddPair(2, 30, 9000, 9060, &view_graph);
  AddPair(2, 31, 9000, 9060, &view_graph);
  AddPair(30, 31, 9000, 9060, &view_graph);
  const Mask as_sequence = Select(scene, view_graph, SequenceMode::kAuto);
  EXPECT_TRUE(as_sequence[true_pair]);
  EXPECT_FALSE(as_sequence[first_wrong]);
  EXPECT_FALSE(as_sequence[first_wrong + 1]);
  const Mask unordered = Select(scene, view_graph);
  EXPECT_FALSE(unordered[true_pair]);
  EXPECT_TRUE(unordered[first_wrong]);
}

// Loops at two places are all stronger than min_strength. Only those of the
// strongest place join the two stretches.
TEST(SkeletalGraph, LoopsOfOnePlaceJoinStretchesOfASequence) {
  const Scene scene = MakeScene(40);
  ViewGraph view_graph;
  for (const int begin : {0, 20}) {
    for (int i = begin; i + 1 < begin + 20; ++i) {
      AddPair(i, i + 1, 100, &view_graph);
    }
  }
  const size_t first_loop = view_graph.pairs.size();
  AddPair(15, 35, 80, &view_graph);
  AddPair(4, 24, 90, &view_graph);
  AddPair(5, 25, 95, &view_graph);
  AddPair(25, 4, 70, &view_graph);
  const Mask selected = Select(scene, view_graph, SequenceMode::kYes);
  EXPECT_FALSE(selected[first_loop]);
  EXPECT_TRUE(selected[first_loop + 1]);
  EXPECT_TRUE(selected[first_loop + 2]);
  EXPECT_TRUE(selected[first_loop + 3]);
  const Mask unordered = Select(scene, view_graph);
  EXPECT_TRUE(unordered[first_loop]);
}

}  // namespace
}  // namespace mgsfm
