// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/displaced_steps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "support/orders.h"
#include "support/single_image_frames.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

constexpr int kDriveLength = 40;
constexpr int kReach = 3;
constexpr int kDisplacedRank = 20;
const Vector3d kStep(0.0, 0.1, 1.0);

// Frames with one image at the origin of the rig, on a straight drive with
// exact pairs of neighbors. The frame of rank k in time has the index
// order[k].
class StraightDrive {
 public:
  explicit StraightDrive(std::vector<int> order = InOrder(kDriveLength))
      : order_(std::move(order)),
        scene_(SingleImageFrames(order_)),
        centers_(kDriveLength) {
    for (int k = 0; k < kDriveLength; ++k) centers_[order_[k]] = k * kStep;
    for (int k = 0; k < kDriveLength; ++k) {
      for (int n = k + 1; n <= std::min(k + kReach, kDriveLength - 1); ++n) {
        Add(k, n);
      }
    }
  }

  // A pair of two frames, by their ranks, that measures their distance and an
  // error.
  void Add(int rank1, int rank2, const Vector3d& error = Vector3d::Zero()) {
    ImagePair pair;
    pair.image_idx1 = order_[rank1];
    pair.image_idx2 = order_[rank2];
    MeasuredBaseline measured;
    measured.baseline_in_world = (rank2 - rank1) * kStep + error;
    if (pair.image_idx1 > pair.image_idx2) {
      std::swap(pair.image_idx1, pair.image_idx2);
      measured.baseline_in_world = -measured.baseline_in_world;
    }
    view_graph_.pairs.push_back(pair);
    measured_.push_back(measured);
  }

  // Moves the estimate of all frames from one on.
  void MoveFrom(int rank, const Vector3d& displacement) {
    for (int k = rank; k < kDriveLength; ++k) {
      *centers_[order_[k]] += displacement;
    }
  }

  // The rig does not move in the step to a frame; the pairs say so.
  void Stand(int rank) {
    MoveFrom(rank, -kStep);
    for (size_t i = 0; i < measured_.size(); ++i) {
      const ImagePair& pair = view_graph_.pairs[i];
      measured_[i]->baseline_in_world =
          *centers_[pair.image_idx2] - *centers_[pair.image_idx1];
    }
  }

  void MakeIncomparable() {
    for (auto& measured : measured_) measured->is_comparable = false;
  }

  StepDeviations Find(SequenceMode mode = SequenceMode::kYes) const {
    const FramePairIndex index(scene_, view_graph_, mode);
    const Mask all(view_graph_.pairs.size(), true);
    const PairFilteringOptions options;
    return FindDisplacedSteps({scene_, index, view_graph_, all, options},
                              {measured_, centers_}, centers_);
  }
  int FrameOf(int rank) const { return order_[rank]; }

 private:
  std::vector<int> order_;
  Scene scene_;
  ViewGraph view_graph_;
  MeasuredBaselines measured_;
  // The centers of the frames, which are those of their only images.
  std::vector<std::optional<Vector3d>> centers_;
};

size_t NumDisplaced(const StepDeviations& deviations) {
  return static_cast<size_t>(
      std::count_if(deviations.begin(), deviations.end(),
                    [](const auto& e) { return e.has_value(); }));
}

TEST(DisplacedSteps, AreFoundWithTheirDeviationInAnyOrderOfFrames) {
  const Vector3d displacement(0.2, 1.5, -0.1);
  for (const auto& order : {InOrder(kDriveLength), Shuffled(kDriveLength)}) {
    StraightDrive drive(order);
    EXPECT_EQ(NumDisplaced(drive.Find()), 0U);
    drive.MoveFrom(kDisplacedRank, displacement);
    const StepDeviations deviations = drive.Find();
    const auto& found = deviations[drive.FrameOf(kDisplacedRank)];
    ASSERT_TRUE(found);
    EXPECT_LT((*found + displacement).norm(), 1e-9);
    EXPECT_EQ(NumDisplaced(deviations), 1U);
    EXPECT_EQ(NumDisplaced(drive.Find(SequenceMode::kNo)), 0U);
  }
}

TEST(DisplacedSteps, AreNoneThatSomePairsSupport) {
  const Vector3d displacement(0.0, 2.0, 0.0);
  StraightDrive drive;
  drive.MoveFrom(kDisplacedRank, displacement);
  for (int i = 0; i < kReach; ++i) {
    drive.Add(kDisplacedRank - 1, kDisplacedRank, displacement);
  }
  EXPECT_EQ(NumDisplaced(drive.Find()), 0U);
}

TEST(DisplacedSteps, AreNotTheDriftOfLoops) {
  StraightDrive drive;
  for (int k = 1; k < kDriveLength; ++k) drive.MoveFrom(k, {0.0, 0.1, 0.0});
  EXPECT_EQ(NumDisplaced(drive.Find()), 0U);
}

TEST(DisplacedSteps, AreNotTheShortStepsOfARigThatStands) {
  StraightDrive drive;
  drive.Stand(kDisplacedRank);
  EXPECT_EQ(NumDisplaced(drive.Find()), 0U);
  drive.MoveFrom(kDisplacedRank, {0.0, 0.3, 0.0});
  EXPECT_EQ(NumDisplaced(drive.Find()), 0U);
}

TEST(DisplacedSteps, NeedPairsOfComparableLength) {
  StraightDrive drive;
  drive.MoveFrom(kDisplacedRank, {0.0, 2.0, 0.0});
  drive.MakeIncomparable();
  EXPECT_EQ(NumDisplaced(drive.Find()), 0U);
}

TEST(DisplacedSteps, DoNotDependOnLoops) {
  StraightDrive drive;
  for (int k = 0; k < kDisplacedRank; ++k) {
    drive.Add(k, kDriveLength - 1, {0.0, 5.0, 0.0});
  }
  EXPECT_EQ(NumDisplaced(drive.Find()), 0U);
}

}  // namespace
}  // namespace mgsfm
