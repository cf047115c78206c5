// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/contested_cuts.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "support/orders.h"

namespace mgsfm {
namespace {

constexpr int kNumFrames = 100;
constexpr int kPartSize = 25;

enum class Verdict { kUsed, kDiscontinuous, kUnused };

// The frame of rank k in time has the index order[k]. Neighbors, at most ten
// steps apart, are connected within each of four parts A, B, C, D of kPartSize
// frames.
class Drive {
 public:
  explicit Drive(std::vector<int> order = InOrder(kNumFrames))
      : order_(std::move(order)) {
    scene_.rigs.push_back({RigId(1), 0, {0}});
    std::vector<int> rank_of_frame(kNumFrames);
    for (int k = 0; k < kNumFrames; ++k) rank_of_frame[order_[k]] = k;
    for (int i = 0; i < kNumFrames; ++i) {
      const auto id = static_cast<uint32_t>(i + 1);
      scene_.images.push_back({ImageId(id), "", 0, 0, i, {}});
      scene_.frames.push_back(
          {FrameId(id), std::to_string(rank_of_frame[i]), 0, {i}});
    }
    for (int gap = 1; gap <= 10; ++gap) {
      for (int k = 0; k + gap < kNumFrames; ++k) {
        if (k / kPartSize == (k + gap) / kPartSize) {
          Add(k, k + gap, Verdict::kUsed);
        }
      }
    }
  }

  // The pair of two frames, by their ranks.
  size_t Add(int rank1, int rank2, Verdict verdict) {
    ImagePair pair;
    std::tie(pair.image_idx1, pair.image_idx2) =
        std::minmax({order_[rank1], order_[rank2]});
    view_graph_.pairs.push_back(pair);
    is_used_.push_back(verdict == Verdict::kUsed);
    is_discontinuous_.push_back(verdict == Verdict::kDiscontinuous);
    return view_graph_.pairs.size() - 1;
  }

  void ContradictMotion(size_t pair) {
    contradicts_motion_ = Mask(view_graph_.pairs.size(), false);
    contradicts_motion_[pair] = true;
  }

  // Moves the last part to another rig.
  void SeparateLastPart() {
    scene_.rigs.push_back({RigId(2), 0, {1}});
    for (int k = kNumFrames - kPartSize; k < kNumFrames; ++k) {
      scene_.frames[order_[k]].rig_idx = 1;
    }
  }

  // Moves the last part to a later time.
  void DelayLastPart(int num_missing) {
    for (int k = kNumFrames - kPartSize; k < kNumFrames; ++k) {
      scene_.frames[order_[k]].name = std::to_string(k + num_missing);
    }
  }

  Mask FindLoops(SequenceMode mode = SequenceMode::kYes) const {
    return FindLoopsAcrossContestedCuts(
        FramePairIndex(scene_, view_graph_, mode), is_used_, is_discontinuous_,
        contradicts_motion_);
  }

 private:
  std::vector<int> order_;
  Scene scene_;
  ViewGraph view_graph_;
  Mask is_used_, is_discontinuous_;
  Mask contradicts_motion_;  // empty or per pair
};

// Contested cuts A | B | C.
void ContestTwoCuts(Drive* drive) {
  drive->Add(24, 25, Verdict::kDiscontinuous);
  drive->Add(22, 27, Verdict::kDiscontinuous);
  drive->Add(48, 51, Verdict::kDiscontinuous);
}

// Loops along a stretch of `num_frames` from two ranks.
std::vector<size_t> PassTwice(int rank1, int rank2, int num_frames,
                              Drive* drive) {
  std::vector<size_t> loops;
  for (int k = 0; k < num_frames; ++k) {
    loops.push_back(drive->Add(rank1 + k, rank2 + k, Verdict::kUsed));
  }
  return loops;
}

TEST(ContestedCutsTest, LoopsAcrossThemAreFound) {
  for (const std::vector<int>& order :
       {InOrder(kNumFrames), Shuffled(kNumFrames)}) {
    Drive drive(order);
    ContestTwoCuts(&drive);
    const std::vector<size_t> across = {
        drive.Add(5, 40, Verdict::kUsed),   // A, B
        drive.Add(26, 70, Verdict::kUsed),  // B, C
        drive.Add(2, 73, Verdict::kUsed),   // A, C: over both cuts
        drive.Add(19, 30, Verdict::kUsed),  // the shortest loop
    };
    drive.Add(2, 20, Verdict::kUsed);    // within A
    drive.Add(52, 74, Verdict::kUsed);   // within C
    drive.Add(6, 41, Verdict::kUnused);  // rejected for another reason
    const Mask is_across = drive.FindLoops();
    EXPECT_EQ(is_across.Count(), across.size());
    for (const size_t i : across) EXPECT_TRUE(is_across[i]) << i;
  }
}

// The parts C and D follow each other, but no pair crosses the cut.
TEST(ContestedCutsTest, SingleLoopsDoNotJoinPartsThatFollowEachOther) {
  for (const std::vector<int>& order :
       {InOrder(kNumFrames), Shuffled(kNumFrames)}) {
    Drive drive(order);
    ContestTwoCuts(&drive);
    const std::vector<size_t> across = {
        drive.Add(5, 90, Verdict::kUsed),   // A, D
        drive.Add(55, 95, Verdict::kUsed),  // C, D
    };
    drive.Add(58, 92, Verdict::kUnused);
    const Mask is_across = drive.FindLoops();
    EXPECT_EQ(is_across.Count(), across.size());
    for (const size_t i : across) EXPECT_TRUE(is_across[i]) << i;
  }
}

TEST(ContestedCutsTest, APlacePassedTwiceJoinsParts) {
  for (const std::vector<int>& order :
       {InOrder(kNumFrames), Shuffled(kNumFrames)}) {
    Drive drive(order);
    ContestTwoCuts(&drive);
    const std::vector<size_t> of_b_and_c = PassTwice(26, 51, 22, &drive);
    const std::vector<size_t> of_c_and_d = PassTwice(51, 76, 22, &drive);
    const size_t single = drive.Add(26, 75, Verdict::kUsed);
    const Mask is_across = drive.FindLoops();
    EXPECT_TRUE(is_across[single]);
    for (const size_t i : of_b_and_c) EXPECT_FALSE(is_across[i]) << i;
    for (const size_t i : of_c_and_d) EXPECT_FALSE(is_across[i]) << i;
  }
}

TEST(ContestedCutsTest, APlacePassedTwiceMustNotContradictTheMotion) {
  Drive drive;
  const std::vector<size_t> of_c_and_d = PassTwice(51, 76, 22, &drive);
  drive.ContradictMotion(of_c_and_d[3]);
  const Mask is_across = drive.FindLoops();
  for (const size_t i : of_c_and_d) {
    EXPECT_EQ(is_across[i], i == of_c_and_d[3]) << i;
  }
}

TEST(ContestedCutsTest, PartsWithoutAnOrderMayBeJoined) {
  Drive drive;
  ContestTwoCuts(&drive);
  drive.Add(5, 90, Verdict::kUsed);
  drive.Add(55, 95, Verdict::kUsed);
  drive.SeparateLastPart();
  EXPECT_FALSE(drive.FindLoops().Any());
}

TEST(ContestedCutsTest, PartsFarApartInTimeMayBeJoined) {
  for (const int num_missing : {9, 10}) {
    Drive drive;
    ContestTwoCuts(&drive);
    const size_t loop = drive.Add(55, 95, Verdict::kUsed);
    drive.DelayLastPart(num_missing);
    EXPECT_EQ(drive.FindLoops()[loop], num_missing == 9) << num_missing;
  }
}

// The path drifts; the pairs of neighbors within a part decide.
TEST(ContestedCutsTest, LoopsWithinAPartMayContradictTheMotion) {
  Drive drive;
  const size_t loop = drive.Add(0, 24, Verdict::kUsed);
  drive.ContradictMotion(loop);
  EXPECT_FALSE(drive.FindLoops()[loop]);
}

TEST(ContestedCutsTest, AContestedPairWithinAPartIsNoCut) {
  Drive drive;
  drive.Add(24, 25, Verdict::kDiscontinuous);
  const size_t loop = drive.Add(5, 40, Verdict::kUsed);
  EXPECT_TRUE(drive.FindLoops()[loop]);
  drive.Add(20, 29, Verdict::kUsed);
  EXPECT_FALSE(drive.FindLoops().Any());
}

TEST(ContestedCutsTest, PairsOfNeighborsAreNoLoops) {
  Drive drive;
  ContestTwoCuts(&drive);
  const size_t loop = drive.Add(19, 30, Verdict::kUsed);
  EXPECT_EQ(drive.FindLoops().Count(), 1u);
  drive.Add(20, 30, Verdict::kUsed);  // closes the cut
  EXPECT_FALSE(drive.FindLoops()[loop]);
}

TEST(ContestedCutsTest, NoneAreFoundWithoutTemporalOrder) {
  Drive drive;
  ContestTwoCuts(&drive);
  drive.Add(5, 40, Verdict::kUsed);
  EXPECT_TRUE(drive.FindLoops().Any());
  const Mask is_across = drive.FindLoops(SequenceMode::kNo);
  EXPECT_EQ(is_across, Mask(is_across.size(), false));
}

TEST(ContestedCutsTest, NoneAreFoundIfNothingIsContested) {
  Drive drive;
  drive.Add(24, 25, Verdict::kUnused);
  drive.Add(5, 40, Verdict::kUsed);
  EXPECT_FALSE(drive.FindLoops().Any());
}

}  // namespace
}  // namespace mgsfm
