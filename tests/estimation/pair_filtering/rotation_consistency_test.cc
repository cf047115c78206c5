// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "geometry/so3.h"
#include "pair_filtering/skeleton_consistency.h"

namespace mgsfm {
namespace {

// A row of single cameras with equal rotations. Neighbors are the skeleton;
// each pair of neighbors is half a degree off.
struct Row {
  explicit Row(int num_frames) {
    for (int i = 0; i < num_frames; ++i) {
      scene.images.push_back(
          {ImageId(static_cast<uint32_t>(i + 1)), "", 0, 0, i, {}});
      scene.frames.push_back(
          {FrameId(static_cast<uint32_t>(i + 1)), "", 0, {i}});
      by_skeleton.rig_from_world.emplace_back(Eigen::Quaterniond::Identity());
      by_skeleton.component.emplace_back(0);
      if (i > 0) Add(i - 1, i, 0.5, true);
    }
    by_skeleton.sensor_from_rig.emplace_back(Eigen::Quaterniond::Identity());
  }
  void Add(int i, int j, double error_deg, bool is_skeleton_edge = false) {
    ImagePair pair;
    pair.image_idx1 = i;
    pair.image_idx2 = j;
    pair.matches.resize(100);
    pair.relative_pose =
        RelativePose{ExpSO3({0.0, DegToRad(error_deg), 0.0}), std::nullopt};
    view_graph.pairs.push_back(pair);
    is_in_skeleton.push_back(is_skeleton_edge);
  }
  // Per pair that is not one of neighbors.
  Mask Inconsistent(const PairFilteringOptions& options = {}) const {
    const FramePairIndex index(scene, view_graph);
    const Mask is_used(view_graph.pairs.size(), true);
    const Mask all =
        FindInconsistentRotations({scene, index, view_graph, is_used, options},
                                  is_in_skeleton, by_skeleton);
    return Mask(all.begin() + static_cast<int>(scene.frames.size()) - 1,
                all.end());
  }

  Scene scene;
  ViewGraph view_graph;
  Mask is_in_skeleton;
  RotationEstimate by_skeleton;
};

// Half a degree is the median norm of 3-vectors whose standard deviation per
// axis is 0.5 / 1.538 = 0.325 deg. Hence the bound 3 + 2 * 0.325 * sqrt(l) deg.
TEST(InconsistentRotations, ExceedTheDriftBoundOfTheirPath) {
  Row row(31);
  row.Add(0, 4, 4.2);
  row.Add(0, 4, 4.4);
  row.Add(2, 27, 6.2);
  row.Add(2, 27, 6.3);
  EXPECT_EQ(row.Inconsistent(), (Mask{0, 1, 0, 1}));
  PairFilteringOptions options;
  options.max_rotation_drift_deg = 1.0;
  EXPECT_EQ(row.Inconsistent(options), (Mask{1, 1, 1, 1}));
}

TEST(InconsistentRotations, AreOnlyJudgedWithinAComponent) {
  Row row(31);
  row.Add(0, 20, 30.0);
  row.Add(0, 30, 30.0);
  row.by_skeleton.component[30] = 1;
  EXPECT_EQ(row.Inconsistent(), (Mask{1, 0}));
  row.by_skeleton.rig_from_world[20].reset();
  EXPECT_EQ(row.Inconsistent(), (Mask{0, 0}));
}

TEST(InconsistentRotations, AreNoneIfTooManyWouldBe) {
  Row row(10);
  for (int k = 0; k < 5; ++k) row.Add(0, 9, 30.0);
  EXPECT_EQ(row.Inconsistent(), Mask(5, false));  // 5 of 14
  Row longer(11);
  for (int k = 0; k < 5; ++k) longer.Add(0, 10, 30.0);
  EXPECT_EQ(longer.Inconsistent(), Mask(5, true));  // 5 of 15
}

// A shortcut with fewer matches than the chain is not part of the tree.
TEST(InconsistentRotations, DriftAlongTheMaximumSpanningTree) {
  Row row(31);
  row.Add(0, 30, 0.0, true);
  row.view_graph.pairs.back().matches.resize(10);
  row.Add(0, 29, 6.4);
  row.Add(0, 29, 6.6);
  EXPECT_EQ(row.Inconsistent(), (Mask{0, 0, 1}));
}

TEST(FramePairIndex, GroupsPairsByFrames) {
  Row row(4);
  row.Add(1, 2, 0.0);
  row.Add(2, 1, 0.0);
  row.Add(3, 3, 0.0);
  const FramePairIndex index(row.scene, row.view_graph);
  EXPECT_EQ(index.num_pairs(), 6u);
  ASSERT_EQ(index.frame_pairs().size(), 4u);
  EXPECT_EQ(index.frame_pairs()[1].pair_idxs, (std::vector<size_t>{1, 3, 4}));
  EXPECT_EQ(&index.Of(4), &index.frame_pairs()[1]);
  EXPECT_EQ(index.Of(4).frame_idx1, 1);
  EXPECT_EQ(index.Of(4).frame_idx2, 2);
  EXPECT_FALSE(index.Of(5).IsBetweenFrames());
}

}  // namespace
}  // namespace mgsfm
