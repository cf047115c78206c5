// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "moving_objects/path_agreement.h"
#include "support/orders.h"

namespace mgsfm {
namespace {

constexpr int kNumPlaces = 40;

// A sequence of one camera. Pairs reach one, two and ten steps, and one is a
// loop. The frame of rank k in time has the index order[k].
class DriveWithSteps {
 public:
  explicit DriveWithSteps(std::vector<int> order) : order_(std::move(order)) {
    scene_.rigs.push_back({RigId(1), 0, {0}});
    scene_.sensors.push_back({"", 0, 0, Rigid3()});
    std::vector<double> times_s(kNumPlaces);
    for (int k = 0; k < kNumPlaces; ++k) times_s[order_[k]] = 0.1 * k;
    for (int i = 0; i < kNumPlaces; ++i) {
      const auto id = static_cast<uint32_t>(i + 1);
      scene_.images.push_back({ImageId(id), "", 0, 0, i, {}, times_s[i]});
      scene_.frames.push_back({FrameId(id), std::to_string(i), 0, {i}});
    }
    for (int k = 0; k < kNumPlaces; ++k) {
      for (int gap = 1; gap <= 10; ++gap) AddPair(k, k + gap);
      AddPair(k, k + kNumPlaces - 1);
    }
    path_.of_frame.resize(kNumPlaces);
  }

  // `steps`: ranks of the frames before them.
  AmbiguousSteps Find(const std::vector<int>& steps) {
    int num_before = 0;
    for (int k = 0; k < kNumPlaces; ++k) {
      path_.of_frame[order_[k]] = RigPath::Place{num_before, num_before, {}};
      for (const int step : steps) num_before += step == k ? 1 : 0;
    }
    const FramePairIndex index(scene_, view_graph_, SequenceMode::kYes);
    return FindAmbiguousSteps(index, path_);
  }

  // The ranks of the frames of each pair.
  const std::vector<std::pair<int, int>>& ranks() const { return ranks_; }
  int IndexOf(int rank) const { return order_[rank]; }

 private:
  void AddPair(int rank1, int rank2) {
    if (rank2 >= kNumPlaces) return;
    ImagePair pair;
    pair.image_idx1 = order_[rank1];
    pair.image_idx2 = order_[rank2];
    view_graph_.pairs.push_back(pair);
    ranks_.emplace_back(rank1, rank2);
  }

  std::vector<int> order_;
  Scene scene_;
  ViewGraph view_graph_;
  std::vector<std::pair<int, int>> ranks_;
  RigPath path_;
};

TEST(AmbiguousSteps, NeighborsAcrossThemAreFound) {
  for (const std::vector<int>& order :
       {InOrder(kNumPlaces), Shuffled(kNumPlaces)}) {
    DriveWithSteps drive(order);
    const AmbiguousSteps found = drive.Find({14, 15});
    for (size_t i = 0; i < drive.ranks().size(); ++i) {
      const auto [rank1, rank2] = drive.ranks()[i];
      const bool is_loop = rank2 - rank1 == kNumPlaces - 1;
      EXPECT_EQ(found.pair_is_across[i], !is_loop && rank1 <= 15 && rank2 >= 15)
          << rank1 << " " << rank2;
    }
    for (int k = 0; k < kNumPlaces; ++k) {
      EXPECT_EQ(found.frame_is_beside[drive.IndexOf(k)], k >= 14 && k <= 16);
    }
  }
}

// 4 of 39 steps are more than a tenth.
TEST(AmbiguousSteps, ManyPutTheMotionsInDoubt) {
  DriveWithSteps drive(InOrder(kNumPlaces));
  EXPECT_TRUE(drive.Find({5, 14, 15}).pair_is_across.Any());
  const AmbiguousSteps found = drive.Find({5, 14, 15, 16});
  EXPECT_FALSE(found.pair_is_across.Any());
  EXPECT_FALSE(found.frame_is_beside.Any());
}

}  // namespace
}  // namespace mgsfm
