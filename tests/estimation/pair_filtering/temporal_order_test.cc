// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <string>
#include <vector>

#include "base/random.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {
namespace {

// Frames of one image each, with these names.
Scene MakeScene(const std::vector<std::string>& names) {
  Scene scene;
  scene.sensors.push_back({"", 0, 0, Rigid3()});
  scene.rigs.push_back({RigId(1), 0, {0}});
  for (size_t i = 0; i < names.size(); ++i) {
    const int idx = static_cast<int>(i);
    const auto id = static_cast<uint32_t>(i + 1);
    scene.images.push_back({ImageId(id), names[i], 0, 0, idx, {}});
    scene.frames.push_back({FrameId(id), names[i], 0, {idx}});
  }
  return scene;
}

std::vector<std::string> Numbers(int num_frames) {
  std::vector<std::string> names;
  for (int i = 0; i < num_frames; ++i)
    names.push_back(std::to_string(1000 + i));
  return names;
}

std::vector<int> Iota(int size) {
  std::vector<int> values(size);
  std::iota(values.begin(), values.end(), 0);
  return values;
}

void Shuffle(Random* random, std::vector<int>::iterator begin,
             std::vector<int>::iterator end) {
  for (auto i = end - begin; i > 1; --i) {
    std::swap(begin[i - 1], begin[random->Index(static_cast<uint32_t>(i))]);
  }
}

// Frames with these ranks in time share fewer matches the further they are
// apart, and none from `range` ranks on.
ViewGraph MatchNeighbors(const std::vector<int>& time_of_frame, int range = 6) {
  const int num_frames = static_cast<int>(time_of_frame.size());
  ViewGraph view_graph;
  for (int i = 0; i < num_frames; ++i) {
    for (int j = i + 1; j < num_frames; ++j) {
      const int gap = std::abs(time_of_frame[i] - time_of_frame[j]);
      if (gap >= range) continue;
      ImagePair pair;
      pair.image_idx1 = i;
      pair.image_idx2 = j;
      pair.matches.resize(20 * (range - gap) / range + 1);
      view_graph.pairs.push_back(pair);
    }
  }
  return view_graph;
}

TEST(TemporalOrder, FollowsNumbersInNames) {
  const Scene scene = MakeScene({"f1", "f10", "f100", "f2", "f9"});
  const TemporalOrder order(scene);
  EXPECT_EQ(order.Gap(0, 3), 1);  // 1, 2
  EXPECT_EQ(order.Gap(3, 4), 1);  // 2, 9
  EXPECT_EQ(order.Gap(1, 4), 1);  // 9, 10
  EXPECT_EQ(order.Gap(2, 0), 4);
}

TEST(TemporalOrder, PrefersTimestamps) {
  Scene scene = MakeScene({"a", "b", "c"});
  scene.images[0].timestamp_s = 2.0;
  scene.images[1].timestamp_s = 0.0;
  EXPECT_EQ(TemporalOrder(scene).Gap(0, 1), 1);  // not all have a time
  scene.images[2].timestamp_s = 1.0;
  EXPECT_EQ(TemporalOrder(scene).Gap(0, 1), 2);
}

// Every third image of a camera, without two of them, and part of another
// recording.
TEST(TemporalOrder, NumbersInNamesTellTheTime) {
  const Scene scene =
      MakeScene({"a10", "a07", "a19", "a22", "b01", "b04", "a25", "b7"});
  const TemporalOrder order(scene);
  EXPECT_EQ(order.Duration(1, 0), 1.0);
  EXPECT_EQ(order.Duration(0, 2), 3.0);
  EXPECT_EQ(order.Duration(2, 3), 1.0);
  EXPECT_EQ(order.Duration(6, 4), 1.0);  // unknown
  EXPECT_EQ(order.Duration(4, 5), 1.0);
  EXPECT_EQ(order.Duration(5, 7), 1.0);
  EXPECT_EQ(order.Gap(0, 2), 1);  // ranks do not count missing frames
}

TEST(TemporalOrder, CaptureTimesCountMoreThanNumbers) {
  Scene scene = MakeScene({"1", "2", "5", "6"});
  const double times_s[] = {0.0, 0.1, 0.2, 0.5};
  for (int i = 0; i < 4; ++i) scene.images[i].timestamp_s = times_s[i];
  const TemporalOrder order(scene);
  EXPECT_NEAR(order.Duration(1, 2), 1.0, 1e-9);
  EXPECT_NEAR(order.Duration(2, 3), 3.0, 1e-9);
}

TEST(TemporalOrder, StepsTakeEquallyLongIfNothingTellsTheTime) {
  for (const std::vector<std::string>& names :
       {std::vector<std::string>{"x", "y", "z"},
        std::vector<std::string>{"1a1", "2b1", "3c1"}}) {
    const TemporalOrder order(MakeScene(names));
    EXPECT_EQ(order.Duration(0, 1), 1.0);
    EXPECT_EQ(order.Duration(1, 2), 1.0);
  }
}

// The next minute, a counter of seconds before that of images, and equal times.
TEST(TemporalOrder, OtherChangesOfNamesTellNoTime) {
  struct Case {
    std::vector<std::string> names;
    int rank;  // of the frame after an unknown interval
  };
  for (const auto& [names, rank] : std::vector<Case>{
           {{"20230501_123459700", "20230501_123459800", "20230501_123459900",
             "20230501_123500000", "20230501_123500100"},
            3},
           {{"12_000", "12_250", "12_500", "13_000", "13_250"}, 3},
           {{"a1", "a2", "a3", "a15", "a16"}, 3},
           {{"1", "2", "3", "03", "4"}, 3}}) {
    const TemporalOrder order(MakeScene(names));
    for (int k = 1; k < 5; ++k) {
      EXPECT_EQ(order.Duration(k - 1, k), 1.0) << names[k];
      EXPECT_EQ(order.IsAfterBreak(k), k == rank) << names[k];
    }
  }
}

TEST(TemporalOrder, ABreakIsALongOrUnknownTime) {
  Scene scene = MakeScene({"a", "b", "c", "d", "e", "f"});
  const TemporalOrder by_rank(scene);  // no interval is known
  const double times_s[] = {0.0, 0.1, 0.2, 0.3, 1.304, 2.4};
  for (int i = 0; i < 6; ++i) scene.images[i].timestamp_s = times_s[i];
  const TemporalOrder by_time(scene);
  for (int i = 0; i < 6; ++i) {
    EXPECT_FALSE(by_rank.IsAfterBreak(i)) << i;
    EXPECT_EQ(by_time.IsAfterBreak(i), i == 5) << i;
  }
}

TEST(TemporalOrder, DoesNotSpanRigs) {
  Scene scene = MakeScene({"a", "b"});
  scene.rigs.push_back({RigId(2), 0, {}});
  scene.frames[1].rig_idx = 1;
  EXPECT_EQ(TemporalOrder(scene).Gap(0, 1), std::nullopt);
}

TEST(TemporalOrder, IsThatOfACameraPath) {
  for (int num_frames = 8; num_frames <= 140; num_frames += 12) {
    for (const int range : {3, 6, 2 * num_frames}) {
      const FramePairIndex index(MakeScene(Numbers(num_frames)),
                                 MatchNeighbors(Iota(num_frames), range));
      EXPECT_TRUE(index.is_sequence()) << num_frames << ' ' << range;
    }
  }
  EXPECT_FALSE(
      FramePairIndex(MakeScene(Numbers(9)), ViewGraph()).is_sequence());
}

// Whether all frames match each other or only a few.
TEST(TemporalOrder, OneRandomOrderInAThousandIsTakenForASequence) {
  Random random(7);
  int num_orders = 0, num_sequences = 0;
  for (int num_frames = 8; num_frames <= 140; num_frames += 3) {
    const Scene scene = MakeScene(Numbers(num_frames));
    std::vector<int> times = Iota(num_frames);
    for (const int range : {4, 2 * num_frames}) {
      for (int k = 0; k < 60; ++k) {
        Shuffle(&random, times.begin(), times.end());
        ++num_orders;
        num_sequences +=
            FramePairIndex(scene, MatchNeighbors(times, range)).is_sequence();
      }
    }
  }
  EXPECT_LE(1000 * num_sequences, num_orders);
}

// Images of five places, in a folder and in random order each, are no sequence;
// if those of each folder are in order, they are.
TEST(TemporalOrder, UnorderedFoldersAreNoSequence) {
  std::vector<std::string> names;
  for (int i = 0; i < 100; ++i) {
    names.push_back(std::string(1, static_cast<char>('a' + i / 20)) +
                    std::to_string(100 + i % 20));
  }
  const Scene scene = MakeScene(names);
  std::vector<int> times = Iota(100);
  EXPECT_TRUE(FramePairIndex(scene, MatchNeighbors(times, 40)).is_sequence());
  Random random(9);
  for (int k = 0; k < 20; ++k) {
    for (int i = 0; i < 100; i += 20) {
      Shuffle(&random, times.begin() + i, times.begin() + i + 20);
    }
    EXPECT_FALSE(
        FramePairIndex(scene, MatchNeighbors(times, 40)).is_sequence());
  }
}

// The frames of a second lap share more matches with those of the first lap
// than with each other.
TEST(TemporalOrder, APathMayVisitPlacesAgain) {
  constexpr int kNumFrames = 60;
  const Scene scene = MakeScene(Numbers(kNumFrames));
  ViewGraph view_graph = MatchNeighbors(Iota(kNumFrames));
  for (int i = 0; i < kNumFrames / 2; ++i) {
    ImagePair pair;
    pair.image_idx1 = i;
    pair.image_idx2 = i + kNumFrames / 2;
    pair.matches.resize(30);
    view_graph.pairs.push_back(pair);
  }
  EXPECT_TRUE(FramePairIndex(scene, view_graph).is_sequence());
}

// If all frames match equally well, matches do not show an order in time.
TEST(TemporalOrder, ImagesOfOneObjectAreNoSequence) {
  const Scene scene = MakeScene(Numbers(40));
  Random random(8);
  ViewGraph view_graph;
  for (int i = 0; i < 40; ++i) {
    for (int j = i + 1; j < 40; ++j) {
      ImagePair pair;
      pair.image_idx1 = i;
      pair.image_idx2 = j;
      pair.matches.resize(80 + random.Index(40));
      view_graph.pairs.push_back(pair);
    }
  }
  EXPECT_FALSE(FramePairIndex(scene, view_graph).is_sequence());
}

}  // namespace
}  // namespace mgsfm
