// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/pair_filtering/skeletal_graph.h"

#include <gmock/gmock.h>
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

// Of keypoints begin_point to end_point, which show the points of these
// numbers.
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

// Of points that no other pair shows.
void AddPair(int image_idx1, int image_idx2, uint32_t num_matches,
             ViewGraph* view_graph) {
  const auto begin_point =
      static_cast<uint32_t>(1000 * view_graph->pairs.size());
  AddPair(image_idx1, image_idx2, begin_point, begin_point + num_matches,
          view_graph);
}

Mask All(const ViewGraph& view_graph) {
  return Mask(view_graph.pairs.size(), true);
}

TEST(Backbone, TakesNeighboursAndNoCopies) {
  const Scene scene = MakeScene(20);
  ViewGraph view_graph;
  Mask is_neighbour;
  for (int i = 0; i + 1 < 20; ++i) {
    AddPair(i, i + 1, 100, &view_graph);
    is_neighbour.push_back(true);
    if (i + 2 < 20) {
      AddPair(i, i + 2, 50, &view_graph);
      is_neighbour.push_back(false);
    }
    if (i + 10 < 20) {
      AddPair(i, i + 10, 40, &view_graph);
      is_neighbour.push_back(false);
    }
  }
  EXPECT_EQ(SelectSkeletalGraph(scene, view_graph, All(view_graph)),
            is_neighbour);
}

TEST(Backbone, WeakLinksConnectWhatNothingElseDoes) {
  const Scene scene = MakeScene(6);
  ViewGraph view_graph;
  AddPair(0, 1, 100, &view_graph);
  AddPair(1, 2, 100, &view_graph);
  AddPair(3, 4, 100, &view_graph);
  AddPair(4, 5, 100, &view_graph);
  AddPair(2, 3, 30, &view_graph);
  AddPair(2, 4, 20, &view_graph);  // nearly as strong
  AddPair(0, 5, 10, &view_graph);  // far weaker
  EXPECT_EQ(SelectSkeletalGraph(scene, view_graph, All(view_graph)),
            (Mask{true, true, true, true, true, true, false}));
}

TEST(Backbone, SpineKeepsCopiesOut) {
  const Scene scene = MakeScene(6);
  ViewGraph view_graph;
  AddPair(0, 1, 100, &view_graph);
  AddPair(1, 2, 100, &view_graph);
  AddPair(2, 3, 80, &view_graph);  // joins what is strong
  AddPair(3, 4, 100, &view_graph);
  AddPair(4, 5, 100, &view_graph);
  AddPair(0, 4, 70, &view_graph);  // a copy on a road with little else
  EXPECT_EQ(SelectSkeletalGraph(scene, view_graph, All(view_graph)),
            Mask(6, true));
  EXPECT_EQ(SelectSkeletalGraph(scene, view_graph, All(view_graph),
                                kStrictSkeletalGraph),
            (Mask{true, true, true, true, true, false}));
}

// Of two frames that each lost images, one has more matches with an unrelated
// place than with its neighbours. But these see the same as each other.
TEST(Backbone, ManyMatchesThatNothingConfirmsMakeNoNeighbours) {
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
  EXPECT_EQ(SelectSkeletalGraph(scene, view_graph, All(view_graph)), expected);
}

// Where nothing else leads there, one is as good as the other.
TEST(Backbone, WhatNothingConfirmsConnectsTheRest) {
  const Scene scene = MakeScene(5);
  ViewGraph view_graph;
  AddPair(0, 1, 0, 50, &view_graph);
  AddPair(0, 2, 0, 50, &view_graph);
  AddPair(1, 2, 0, 50, &view_graph);
  AddPair(2, 3, 60, &view_graph);
  AddPair(1, 3, 20, &view_graph);
  AddPair(3, 4, 30, &view_graph);
  EXPECT_EQ(SelectSkeletalGraph(scene, view_graph, All(view_graph)),
            (Mask{true, true, true, true, false, true}));
}

TEST(Backbone, LeavesOutWhatIsNotUsed) {
  const Scene scene = MakeScene(3);
  ViewGraph view_graph;
  AddPair(0, 1, 100, &view_graph);
  AddPair(1, 2, 50, &view_graph);
  EXPECT_EQ(SelectSkeletalGraph(scene, view_graph, {false, true}),
            (Mask{false, true}));
}

TEST(SuspiciousGroups, AreStretchesOfNeighbours) {
  const Scene scene = MakeScene(100);
  ViewGraph view_graph;
  AddPair(10, 50, 20, &view_graph);
  AddPair(11, 52, 20, &view_graph);
  AddPair(12, 49, 20, &view_graph);
  AddPair(12, 90, 20, &view_graph);  // shares an end only
  AddPair(10, 51, 20, &view_graph);  // not suspicious
  const std::vector<RejectedGroup> groups =
      GroupRejectedPairs(scene, view_graph, {true, true, true, true, false});
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_EQ(groups[0].num_pairs, 3);
  EXPECT_EQ(groups[0].first_frame_idx1, 10);
  EXPECT_EQ(groups[0].last_frame_idx1, 12);
  EXPECT_EQ(groups[0].first_frame_idx2, 49);
  EXPECT_EQ(groups[0].last_frame_idx2, 52);
  EXPECT_EQ(groups[1].num_pairs, 1);
  EXPECT_EQ(groups[1].first_frame_idx2, 90);
}

TEST(SuspiciousGroups, AreOfVehiclesIfNear) {
  const Scene scene = MakeScene(100);
  const auto describe = [&](const RejectedGroup& group) {
    return DescribeRejectedGroup(scene, group);
  };
  EXPECT_THAT(describe({7, 10, 30, 20, 45}),
              testing::AllOf(testing::HasSubstr("7 pairs"),
                             testing::HasSubstr("vehicles")));
  EXPECT_THAT(describe({7, 10, 30, 35, 45}), testing::HasSubstr("vehicles"));
  EXPECT_THAT(describe({7, 10, 30, 60, 75}), testing::HasSubstr("alike"));
}

}  // namespace
}  // namespace mgsfm
