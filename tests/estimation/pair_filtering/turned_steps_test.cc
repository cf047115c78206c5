// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "pair_filtering/displaced_steps.h"
#include "support/orders.h"
#include "support/single_image_frames.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kTurningDriveLength = 60;
constexpr int kTurningReach = 3;
constexpr int kTurnedRank = 20;

// The rig turns steadily. The frame of rank k in time has the index order[k].
// Neighbors have exact pairs; the estimated rotations can be turned.
class TurningDrive {
 public:
  explicit TurningDrive(std::vector<int> order = InOrder(kTurningDriveLength))
      : order_(std::move(order)), scene_(SingleImageFrames(order_)) {
    estimate_.sensor_from_rig.emplace_back(ExpSO3({0.1, 0.2, -0.3}));
    estimate_.rig_from_world.resize(kTurningDriveLength);
    estimate_.component.assign(kTurningDriveLength, 0);
    for (int k = 0; k < kTurningDriveLength; ++k) {
      estimate_.rig_from_world[order_[k]] = RigFromWorld(k);
    }
    for (int k = 0; k < kTurningDriveLength; ++k) {
      for (int n = k + 1;
           n <= std::min(k + kTurningReach, kTurningDriveLength - 1); ++n) {
        Add(k, n);
      }
    }
  }

  // A pair of two frames, by their ranks, off by a rotation in the world.
  size_t Add(int rank1, int rank2, const Vector3d& error_rad = {0, 0, 0}) {
    const bool is_in_order = order_[rank1] < order_[rank2];
    if (!is_in_order) std::swap(rank1, rank2);
    const Vector3d error = is_in_order ? error_rad : Vector3d(-error_rad);
    const Quaterniond& sensor = *estimate_.sensor_from_rig[0];
    ImagePair pair;
    pair.image_idx1 = order_[rank1];
    pair.image_idx2 = order_[rank2];
    pair.relative_pose =
        RelativePose{sensor * RigFromWorld(rank2) * ExpSO3(error) *
                         RigFromWorld(rank1).conjugate() * sensor.conjugate(),
                     std::nullopt};
    view_graph_.pairs.push_back(pair);
    return view_graph_.pairs.size() - 1;
  }

  // Turns the estimate from a frame on, as wrong loop pairs do.
  void TurnFrom(int rank, const Vector3d& turn_rad) {
    for (int k = rank; k < kTurningDriveLength; ++k) {
      auto& rotation = estimate_.rig_from_world[order_[k]];
      rotation = *rotation * ExpSO3(-turn_rad);
    }
  }

  Mask Find(SequenceMode mode = SequenceMode::kYes) const {
    const FramePairIndex index(scene_, view_graph_, mode);
    const Mask all(view_graph_.pairs.size(), true);
    const PairFilteringOptions options;
    return FindTurnedSteps({scene_, index, view_graph_, all, options},
                           estimate_);
  }
  int FrameOf(int rank) const { return order_[rank]; }

 private:
  static Quaterniond RigFromWorld(int rank) {
    return ExpSO3({0.01, 0.03 * rank, -0.02});
  }

  std::vector<int> order_;
  Scene scene_;
  ViewGraph view_graph_;
  RotationEstimate estimate_;
};

TEST(TurnedSteps, AreFoundInAnyOrderOfFrames) {
  const Vector3d turn(0.01, DegToRad(3.0), -0.02);
  for (const auto& order :
       {InOrder(kTurningDriveLength), Shuffled(kTurningDriveLength)}) {
    TurningDrive drive(order);
    EXPECT_FALSE(drive.Find().Any());
    drive.TurnFrom(kTurnedRank, turn);
    const Mask is_turned = drive.Find();
    EXPECT_TRUE(is_turned[drive.FrameOf(kTurnedRank)]);
    EXPECT_EQ(is_turned.Count(), 1U);
    EXPECT_FALSE(drive.Find(SequenceMode::kNo).Any());
  }
}

TEST(TurnedSteps, AreNoneThatAPairOfFewSupports) {
  TurningDrive drive;
  drive.TurnFrom(kTurnedRank, {0.0, DegToRad(3.0), 0.0});
  // As many pairs support the turned rotation.
  for (int i = 0; i < kTurningReach; ++i) {
    drive.Add(kTurnedRank - 1, kTurnedRank, {0.0, DegToRad(-3.0), 0.0});
  }
  EXPECT_FALSE(drive.Find().Any());
}

TEST(TurnedSteps, AreNotTheDriftOfLoops) {
  TurningDrive drive;
  for (int k = 1; k < kTurningDriveLength; ++k) {
    drive.TurnFrom(k, {0.0, DegToRad(0.3), 0.0});
  }
  EXPECT_FALSE(drive.Find().Any());
}

}  // namespace
}  // namespace mgsfm
