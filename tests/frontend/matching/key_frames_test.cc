// SPDX-License-Identifier: BSD-3-Clause
#include "matching/key_frames.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <numeric>
#include <string_view>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "frontend/matching/rig_scene.h"

namespace mgsfm {
namespace {

// What the images of a slot in two frames of a sequence share, in [0, 1].
using Overlap = std::function<double(int slot, int frame1, int frame2)>;

// Pairs of one sensor have inliers in proportion to their overlap; half of the
// features repeat. Pairs of different sensors have none.
class Recording {
 public:
  Recording(int num_slots, int num_frames, Overlap overlap)
      : scene_(MakeRigScene(num_slots, num_frames)),
        sequences_(MakeFrameSequences(scene_)),
        overlap_(std::move(overlap)),
        slot_(scene_.images.size()),
        frame_(scene_.images.size()) {
    for (int i = 0; i < sequences_[0].num_frames(); ++i) {
      for (int slot = 0; slot < num_slots; ++slot) {
        slot_[*sequences_[0].images[i][slot]] = slot;
        frame_[*sequences_[0].images[i][slot]] = i;
      }
    }
  }

  PairTrial trial() {
    return {[this](const ImagePairList& pairs, std::string_view) {
              matched_.insert(matched_.end(), pairs.begin(), pairs.end());
              SortUnique(&matched_);
            },
            [this](const ImageIdxPair& pair) {
              EXPECT_TRUE(
                  std::binary_search(matched_.begin(), matched_.end(), pair));
              return NumInliers(pair);
            }};
  }

  std::vector<int> KeyFramesOf() {
    const KeyFrames keys = FindKeyFrames(sequences_, trial());
    std::vector<int> frames;
    for (const auto& images : keys.sequences[0].images) {
      frames.push_back(frame_[*images[0]]);
    }
    return frames;
  }

  NeighborPairs Neighbors(const SequentialPairOptions& options) {
    return SelectNeighbors(scene_, options, trial());
  }

  const std::vector<int>& frame_of_image() const { return frame_; }

 private:
  size_t NumInliers(const ImageIdxPair& pair) const {
    const int slot = slot_[pair.image_idx1];
    if (slot != slot_[pair.image_idx2]) return 0;
    constexpr double kNumRepeated = 500.0;
    return static_cast<size_t>(
        kNumRepeated * std::max(0.0, overlap_(slot, frame_[pair.image_idx1],
                                              frame_[pair.image_idx2])));
  }

  Scene scene_;
  std::vector<FrameSequence> sequences_;
  Overlap overlap_;
  std::vector<int> slot_, frame_;  // per image
  ImagePairList matched_;
};

// A view that moves by `step` of its width per frame.
Overlap Moving(double step) {
  return [=](int, int a, int b) { return 1.0 - step * std::abs(a - b); };
}

std::vector<int> AllFrames(int num_frames) {
  std::vector<int> frames(num_frames);
  std::iota(frames.begin(), frames.end(), 0);
  return frames;
}

TEST(KeyFrames, AllFramesOfALowRate) {
  EXPECT_EQ(Recording(2, 33, Moving(0.3)).KeyFramesOf(), AllFrames(33));
}

TEST(KeyFrames, AreAsFarApartAtAnyRate) {
  for (const int rate : {1, 2, 4, 8}) {
    Recording recording(1, 32 * rate + 1, Moving(0.16 / rate));
    std::vector<int> expected = AllFrames(33);
    for (int& frame : expected) frame *= rate;
    EXPECT_EQ(recording.KeyFramesOf(), expected) << rate;
  }
}

TEST(KeyFrames, EndWhereTheRigStandsAndWhereItsViewsBreak) {
  const auto standing = [](int, int, int) { return 1.0; };
  EXPECT_EQ(Recording(2, 65, standing).KeyFramesOf(),
            (std::vector<int>{0, 64}));
  const auto cut_before_40 = [](int, int a, int b) {
    return (a < 40) == (b < 40) ? 1.0 : 0.0;
  };
  const std::vector<int> keys = Recording(2, 65, cut_before_40).KeyFramesOf();
  EXPECT_TRUE(std::binary_search(keys.begin(), keys.end(), 39));
  EXPECT_TRUE(std::binary_search(keys.begin(), keys.end(), 40));
}

TEST(KeyFrames, FollowTheSensorThatSeesMostChange) {
  const auto one_moves = [](int slot, int a, int b) {
    return slot == 0 ? 1.0 : 1.0 - 0.3 * std::abs(a - b);
  };
  EXPECT_EQ(Recording(2, 17, one_moves).KeyFramesOf(), AllFrames(17));
  const auto one_is_blind = [](int slot, int, int) {
    return slot == 0 ? 1.0 : 0.0;
  };
  EXPECT_EQ(Recording(2, 17, one_is_blind).KeyFramesOf(),
            (std::vector<int>{0, 16}));
}

TEST(Neighbors, AreThoseOfAllFramesAtALowRate) {
  SequentialPairOptions options;
  NeighborPairs with = Recording(2, 40, Moving(0.3)).Neighbors(options);
  options.use_key_frames = false;
  EXPECT_EQ(with.pairs, Recording(2, 40, Moving(0.3)).Neighbors(options).pairs);
}

TEST(Neighbors, OfAHighRateAreFewAndConnectAllFrames) {
  Recording recording(2, 241, Moving(0.02));
  SequentialPairOptions options;
  const NeighborPairs few = recording.Neighbors(options);
  options.use_key_frames = false;
  EXPECT_LT(2 * few.pairs.size(), recording.Neighbors(options).pairs.size());
  std::vector<int> num_of_frame(241);
  for (const ImageIdxPair& pair : few.pairs) {
    ++num_of_frame[recording.frame_of_image()[pair.image_idx1]];
    ++num_of_frame[recording.frame_of_image()[pair.image_idx2]];
  }
  for (const int number : num_of_frame) EXPECT_GE(number, 2);
}

}  // namespace
}  // namespace mgsfm
