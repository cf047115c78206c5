// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "mgsfm/base/mask.h"
#include "pair_filtering/skeleton_consistency.h"

namespace mgsfm {
namespace {

// A row of single cameras, one unit apart. Neighbors are the skeleton.
struct Row {
  explicit Row(int num_frames) {
    for (int i = 0; i < num_frames; ++i) {
      scene.images.push_back(
          {ImageId(static_cast<uint32_t>(i + 1)), "", 0, 0, i, {}});
      scene.frames.push_back(
          {FrameId(static_cast<uint32_t>(i + 1)), "", 0, {i}});
      by_skeleton.centers.emplace_back(Eigen::Vector3d(i, 0.0, 0.0));
      if (i > 0) Add(i - 1, i, 1.0, true);
    }
  }
  void Add(int i, int j, double length, bool is_skeleton_edge = false) {
    ImagePair pair;
    pair.image_idx1 = i;
    pair.image_idx2 = j;
    pair.matches.resize(100);
    view_graph.pairs.push_back(pair);
    by_skeleton.measured.emplace_back(
        MeasuredBaseline{length * Eigen::Vector3d::UnitX(), 1.0, true});
    is_in_skeleton.push_back(is_skeleton_edge);
  }
  // One entry per pair that does not connect neighbors.
  Mask Inconsistent(double max_drift) const {
    const FramePairIndex index(scene, view_graph);
    const Mask is_used(view_graph.pairs.size(), true);
    const PairFilteringOptions options;
    const Mask all =
        FindInconsistentBaselines({scene, index, view_graph, is_used, options},
                                  is_in_skeleton, by_skeleton, max_drift);
    return Mask(all.begin() + static_cast<int>(scene.frames.size()) - 1,
                all.end());
  }
  Mask Contradicting(const CameraCenters& centers) const {
    return FindInconsistentPairs(view_graph, {by_skeleton.measured, centers},
                                 {});
  }
  int CountViolated(const CameraCenters& centers) const {
    return CountViolatedSkeletonEdges(view_graph, is_in_skeleton, by_skeleton,
                                      {by_skeleton.measured, centers}, {});
  }

  Scene scene;
  ViewGraph view_graph;
  Mask is_in_skeleton;
  BaselineComparison by_skeleton;
};

TEST(InconsistentBaselines, ExceedTheDriftBoundOfTheirPath) {
  Row row(21);
  row.Add(0, 20, 20.0);  // exact
  row.Add(0, 20, 17.0);  // off by 3 on a path of 20
  row.Add(0, 20, 1.0);   // a duplicate of something near
  row.Add(4, 6, 1.8);    // within a quarter of a depth
  row.Add(4, 6, 1.0);
  EXPECT_EQ(row.Inconsistent(0.2), (Mask{0, 0, 1, 0, 1}));
  EXPECT_EQ(row.Inconsistent(0.1), (Mask{0, 1, 1, 0, 1}));
}

TEST(InconsistentBaselines, AreNoneIfTooManyWouldBe) {
  Row row(5);
  for (int k = 0; k < 10; ++k) row.Add(0, 4, 0.5);
  EXPECT_EQ(row.Inconsistent(0.2), Mask(10, false));
}

TEST(InconsistentBaselines, AreOnlyThoseThatCanBeCompared) {
  Row row(21);
  row.Add(0, 20, 1.0);
  row.by_skeleton.measured.back()->is_comparable = false;
  row.Add(0, 20, 1.0);
  row.by_skeleton.measured.back().reset();
  row.Add(0, 20, 1.0);
  EXPECT_EQ(row.Inconsistent(0.2), (Mask{0, 0, 1}));
  row.by_skeleton.centers[20].reset();
  EXPECT_EQ(row.Inconsistent(0.2), (Mask{0, 0, 0}));
}

TEST(InconsistentBaselines, AreTriedWithTighterBounds) {
  EXPECT_EQ(BaselineDriftBounds({}),
            (std::vector<double>{0.2, 0.1, 0.05, 0.02}));
}

// Both the relative error and that in depths must be large.
TEST(InconsistentPairs, MissByMoreThanDriftCan) {
  Row row(6);
  row.Add(0, 5, 2.0);   // 3 of 5, and 3 depths
  row.Add(0, 5, 3.0);   // 2 of 5 is less than half
  row.Add(0, 5, 11.0);  // 6 of the longer one, 11
  row.Add(0, 5, 0.0);
  row.by_skeleton.measured.back()->typical_depth = 21.0;  // 5 of 5.25
  row.Add(0, 5, 0.0);
  row.by_skeleton.measured.back().reset();
  Mask expected(10, false);
  expected[5] = expected[7] = true;
  EXPECT_EQ(row.Contradicting(row.by_skeleton.centers), expected);
  CameraCenters centers = row.by_skeleton.centers;
  centers[5].reset();
  EXPECT_EQ(row.Contradicting(centers), Mask(10, false));
}

TEST(ViolatedSkeletonEdges, AreContradictedOrMissing) {
  Row row(6);
  row.Add(0, 5, 1.0);  // not in the skeleton
  CameraCenters centers = row.by_skeleton.centers;
  EXPECT_EQ(row.CountViolated(centers), 0);
  centers[5]->x() += 2.0;
  EXPECT_EQ(row.CountViolated(centers), 1);
  // A component that is missing as a whole is violated, too.
  centers = row.by_skeleton.centers;
  centers[0].reset();
  centers[1].reset();
  EXPECT_EQ(row.CountViolated(centers), 2);
  // A pair that the positions of the skeleton contradict does not count.
  const auto set_last_length = [&](double length) {
    row.by_skeleton.measured[4]->baseline_in_world =
        length * Eigen::Vector3d::UnitX();
  };
  set_last_length(5.0);
  centers = row.by_skeleton.centers;
  EXPECT_EQ(row.CountViolated(centers), 0);
  centers[5]->x() -= 3.0;
  EXPECT_EQ(row.CountViolated(centers), 0);
  set_last_length(1.0);
  EXPECT_EQ(row.CountViolated(centers), 1);
  // Images without a position by the skeleton cannot be missing.
  centers = row.by_skeleton.centers;
  for (const int i : {0, 1}) {
    centers[i].reset();
    row.by_skeleton.centers[i].reset();
  }
  EXPECT_EQ(row.CountViolated(centers), 0);
}

}  // namespace
}  // namespace mgsfm
