// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "pair_filtering/frame_pair_index.h"

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

void AddPair(int image_idx1, int image_idx2, ViewGraph* view_graph) {
  ImagePair pair;
  pair.image_idx1 = image_idx1;
  pair.image_idx2 = image_idx2;
  view_graph->pairs.push_back(pair);
}

TEST(RejectedGroups, AreStretchesOfNeighbors) {
  const Scene scene = MakeScene(100);
  ViewGraph view_graph;
  AddPair(10, 50, &view_graph);
  AddPair(11, 52, &view_graph);
  AddPair(12, 49, &view_graph);
  AddPair(12, 90, &view_graph);  // shares an end only
  AddPair(10, 51, &view_graph);  // not rejected
  const std::vector<RejectedGroup> groups = GroupRejectedPairs(
      FramePairIndex(scene, view_graph), {true, true, true, true, false});
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_THAT(groups[0].pair_idxs, testing::UnorderedElementsAre(0, 1, 2));
  EXPECT_EQ(groups[0].first_frame_idx1, 10);
  EXPECT_EQ(groups[0].last_frame_idx1, 12);
  EXPECT_EQ(groups[0].first_frame_idx2, 49);
  EXPECT_EQ(groups[0].last_frame_idx2, 52);
  EXPECT_THAT(groups[1].pair_idxs, testing::ElementsAre(3));
  EXPECT_EQ(groups[1].first_frame_idx2, 90);
}

TEST(RejectedGroups, AreDescribedByTheirFramesAndNoCause) {
  EXPECT_EQ(DescribeRejectedGroup(MakeScene(100),
                                  {{0, 1, 2, 3, 4, 5, 6}, 10, 30, 20, 45})
                .rfind("7 pairs between frames", 0),
            0u);
}

TEST(PairVerdicts, TheFirstReasonHolds) {
  PairVerdicts verdicts(4);
  Reject({true, false, false, true}, RejectionReason::kNoRelativePose,
         &verdicts);
  Reject({true, true, false, false}, RejectionReason::kUnsupportedBridge,
         &verdicts);
  EXPECT_EQ(verdicts,
            (PairVerdicts{RejectionReason::kNoRelativePose,
                          RejectionReason::kUnsupportedBridge, std::nullopt,
                          RejectionReason::kNoRelativePose}));
  size_t num_rejected = 0;
  for (const RejectionCount& count : CountRejections(verdicts)) {
    num_rejected += count.num_pairs;
    if (count.reason == RejectionReason::kNoRelativePose) {
      EXPECT_EQ(count.num_pairs, 2u);
    }
  }
  EXPECT_EQ(num_rejected, 3u);
  EXPECT_EQ(EnumName(RejectionReason::kUnsupportedBridge),
            "unsupported_bridge");
}

}  // namespace
}  // namespace mgsfm
