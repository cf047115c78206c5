// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/revisits.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "support/orders.h"
#include "support/single_image_frames.h"

namespace mgsfm {
namespace {

constexpr int kNumLoopFrames = 120;
constexpr int kSecondPass = 80;  // its first rank
constexpr int kNeighborReach = 10;

// Loop pairs between frames, by their ranks. The frame of rank k in time has
// the index order[k]. Pairs of neighbors, which are not used, reach over
// kNeighborReach frames.
class RevisitLoops {
 public:
  explicit RevisitLoops(std::vector<int> order = InOrder(kNumLoopFrames))
      : order_(std::move(order)), scene_(SingleImageFrames(order_)) {
    for (int gap = 1; gap <= kNeighborReach; ++gap) {
      for (int k = 0; k + gap < kNumLoopFrames; ++k) {
        AddPair(k, k + gap);
        is_used_.push_back(false);
      }
    }
    num_neighbors_ = is_used_.size();
  }

  void Add(int rank1, int rank2) {
    AddPair(rank1, rank2);
    is_used_.push_back(true);
  }
  // Pairs of frames of two passes along the same stretch.
  void AddPasses(int length, int spacing, bool is_reversed) {
    for (int k = 0; k <= length; k += spacing) {
      Add(k, kSecondPass + (is_reversed ? length - k : k));
    }
  }
  // All pairs of two groups of frames.
  void AddDuplicate(int size1, int size2) {
    for (int i = 0; i < size1; ++i) {
      for (int k = 0; k < size2; ++k) Add(i, kSecondPass + k);
    }
  }
  void DoNotUse(size_t loop) { is_used_[num_neighbors_ + loop] = false; }

  Mask Find(SequenceMode mode = SequenceMode::kYes) const {
    return FindRevisits(FramePairIndex(scene_, view_graph_, mode), is_used_);
  }
  bool AreAllRevisits() const {
    const size_t num_revisits = Find().Count();
    EXPECT_TRUE(num_revisits == 0 || num_revisits == is_used_.Count());
    return num_revisits > 0;
  }

 private:
  void AddPair(int rank1, int rank2) {
    ImagePair pair;
    std::tie(pair.image_idx1, pair.image_idx2) =
        std::minmax({order_[rank1], order_[rank2]});
    view_graph_.pairs.push_back(pair);
  }

  std::vector<int> order_;
  Scene scene_;
  ViewGraph view_graph_;
  Mask is_used_;
  size_t num_neighbors_ = 0;
};

TEST(Revisits, AreLongInBothPassesInAnyOrderOfFrames) {
  for (const auto& order :
       {InOrder(kNumLoopFrames), Shuffled(kNumLoopFrames)}) {
    for (const bool is_reversed : {false, true}) {
      RevisitLoops loops(order);
      loops.AddPasses(2 * kNeighborReach + 1, 1, is_reversed);
      EXPECT_TRUE(loops.AreAllRevisits());
      EXPECT_FALSE(loops.Find(SequenceMode::kNo).Any());
    }
  }
}

TEST(Revisits, AreNotDuplicateStructures) {
  RevisitLoops loops;
  loops.AddPasses(2 * kNeighborReach, 1, false);
  EXPECT_FALSE(loops.AreAllRevisits());
  // A rig that stands still sees a duplicate in any number of frames.
  RevisitLoops standing;
  standing.AddDuplicate(40, kNeighborReach);
  EXPECT_FALSE(standing.AreAllRevisits());
}

TEST(Revisits, AreNotOnePass) {
  RevisitLoops loops;
  for (int k = 0; k <= 50; ++k) loops.Add(k, k + kNeighborReach + 2);
  EXPECT_FALSE(loops.AreAllRevisits());
}

TEST(Revisits, HaveShortGapsOnly) {
  RevisitLoops with_short_gaps, with_long_gaps;
  with_short_gaps.AddPasses(30, 3, true);
  with_long_gaps.AddPasses(32, 4, true);
  EXPECT_TRUE(with_short_gaps.AreAllRevisits());
  EXPECT_FALSE(with_long_gaps.AreAllRevisits());
}

TEST(Revisits, ConsistOfUsedLoops) {
  RevisitLoops loops;
  loops.AddPasses(30, 3, false);
  loops.Add(0, kNeighborReach);  // neighbors, no loop
  EXPECT_EQ(loops.Find().Count(), 11U);
  loops.DoNotUse(5);  // leaves two parts of 12 steps
  EXPECT_FALSE(loops.Find().Any());
}

}  // namespace
}  // namespace mgsfm
