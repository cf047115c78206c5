// SPDX-License-Identifier: BSD-3-Clause
#include "translation/impossible_pairs.h"

#include <gtest/gtest.h>

#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// A row of single cameras, one unit apart, whose neighbours are the backbone.
struct Row {
  explicit Row(int num_frames) {
    problem.num_frames = num_frames;
    problem.sensor_kind = {SensorKind::kFixed};
    problem.fixed_translation = {Eigen::Vector3d::Zero()};
    Positions& positions = by_skeleton.positions;
    positions.sensor_translation = problem.fixed_translation;
    by_skeleton.group_factor = {1.0};
    scales.typical_depth = 1.0;
    for (int i = 0; i < num_frames; ++i) {
      problem.world_from_cam.emplace_back(Eigen::Matrix3d::Identity());
      problem.frame_idx.push_back(i);
      problem.sensor_idx.push_back(0);
      positions.frame_is_placed.push_back(true);
      positions.frame_center.emplace_back(i, 0.0, 0.0);
      if (i > 0) Add(i - 1, i, 1.0, true);
    }
  }
  void Add(int i, int j, double length, bool is_in_the_backbone = false) {
    BaselineDirection motion;
    motion.image_idx1 = i;
    motion.image_idx2 = j;
    motion.kind = BaselineKind::kDirection;
    motion.direction = Eigen::Vector3d::UnitX();
    motions.push_back(motion);
    scales.scale.push_back(length);
    scales.group.push_back(0);
    is_in_skeleton.push_back(is_in_the_backbone);
  }
  Mask Impossible(double max_drift) const {
    const std::vector<int> num_matches(motions.size(), 100);
    const Mask all =
        FindInconsistentBaselines(problem, motions, num_matches, is_in_skeleton,
                                  scales, by_skeleton, max_drift);
    return Mask(all.begin() + problem.num_frames - 1, all.end());
  }

  PositionProblem problem;
  std::vector<BaselineDirection> motions;
  PairScales scales;
  Mask is_in_skeleton;
  InitialPositions by_skeleton;
};

TEST(ImpossiblePairsTest, GoByTheWayAndTheDriftThatIsAllowed) {
  Row row(21);
  row.Add(0, 20, 20.0);  // exact
  row.Add(0, 20, 17.0);  // 3 of a way of 20
  row.Add(0, 20, 1.0);   // a copy of what is near
  row.Add(4, 6, 1.8);    // what a quarter of a depth allows
  row.Add(4, 6, 1.0);
  EXPECT_EQ(row.Impossible(0.2), (Mask{0, 0, 1, 0, 1}));
  EXPECT_EQ(row.Impossible(0.1), (Mask{0, 1, 1, 0, 1}));
}

TEST(ImpossiblePairsTest, NothingIsIfItWereTooMuch) {
  Row row(5);
  for (int k = 0; k < 10; ++k) row.Add(0, 4, 0.5);
  EXPECT_EQ(row.Impossible(0.2), Mask(10, 0));
}

TEST(ImpossiblePairsTest, PairsAreTornByPositionsAndWhereFramesAreMissing) {
  Row row(6);
  row.Add(0, 5, 1.0);  // not of the backbone
  const auto num_violated = [&](const InitialPositions& initial) {
    return CountViolatedSkeletonEdges(row.problem, row.motions,
                                      row.is_in_skeleton, row.scales,
                                      row.by_skeleton, initial);
  };
  InitialPositions initial = row.by_skeleton;
  EXPECT_EQ(num_violated(initial), 0);
  initial.positions.frame_center[5].x() += 2.0;
  EXPECT_EQ(num_violated(initial), 1);
  // A part that is left out as a whole is torn off, too.
  initial = row.by_skeleton;
  initial.positions.frame_is_placed[0] = false;
  initial.positions.frame_is_placed[1] = false;
  EXPECT_EQ(num_violated(initial), 2);
  // What the backbone itself contradicts is a wrong pair.
  row.scales.scale[4] = 5.0;
  initial = row.by_skeleton;
  EXPECT_EQ(num_violated(initial), 0);
  initial.positions.frame_center[5].x() -= 3.0;
  EXPECT_EQ(num_violated(initial), 0);
  row.scales.scale[4] = 1.0;
  EXPECT_EQ(num_violated(initial), 1);
  // What the backbone does not have cannot be missed.
  initial = row.by_skeleton;
  initial.positions.frame_is_placed[0] = false;
  initial.positions.frame_is_placed[1] = false;
  row.by_skeleton.positions.frame_is_placed[0] = false;
  row.by_skeleton.positions.frame_is_placed[1] = false;
  EXPECT_EQ(num_violated(initial), 0);
}

}  // namespace
}  // namespace mgsfm
