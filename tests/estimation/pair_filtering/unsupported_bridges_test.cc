// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/unsupported_bridges.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

using Pairs = std::vector<size_t>;

// Frames with one image each.
class Graph {
 public:
  explicit Graph(int num_frames) {
    for (int i = 0; i < num_frames; ++i) {
      scene_.images.push_back(
          {ImageId(static_cast<uint32_t>(i + 1)), "", 0, 0, i, {}});
      scene_.frames.push_back(
          {FrameId(static_cast<uint32_t>(i + 1)), "", 0, {i}});
    }
  }

  // Matches of points that no other pair observes; returns the pair.
  size_t AddPair(int frame1, int frame2, uint32_t num_matches,
                 bool is_consistent = true) {
    const auto point = static_cast<uint32_t>(1000 + num_points_);
    num_points_ += num_matches;
    return AddPair(frame1, frame2, point, point + num_matches, is_consistent);
  }

  // Frames that all observe the same points.
  void AddPlace(int begin_frame, int end_frame) {
    for (int f = begin_frame; f < end_frame; ++f) {
      for (int g = f + 1; g < end_frame; ++g) AddPair(f, g, 0, 20, true);
    }
  }

  // Frames on a path: each shares points with the three next ones.
  void AddPath(int begin_frame, int end_frame) {
    for (int f = begin_frame; f < end_frame; ++f) {
      const auto first = static_cast<uint32_t>(100 * f);
      for (int g = f + 1; g < std::min(f + 4, end_frame); ++g) {
        // A point of frame f has the numbers 100 f to 100 f + 20.
        AddPair(f, g, first, first + 20, true);
      }
      if (f + 2 < end_frame) AddPair(f + 1, f + 2, first, first + 20, true);
    }
  }

  // Frames of two paths that look alike.
  size_t AddLoop(int frame1, int frame2) {
    const auto first = static_cast<uint32_t>(100 * frame1);
    if (frame1 + 1 < num_frames()) {
      AddPair(frame1 + 1, frame2, first, first + 20, true);
    }
    return AddPair(frame1, frame2, first, first + 20, true);
  }
  int num_frames() const { return static_cast<int>(scene_.frames.size()); }

  void Reject(int frame1, int frame2) {
    for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
      const ImagePair& pair = view_graph_.pairs[i];
      if (pair.image_idx1 == frame1 && pair.image_idx2 == frame2) {
        is_consistent_[i] = false;
      }
    }
  }

  // A pair that shows an object.
  void Explain(size_t pair_idx) { explained_.push_back(pair_idx); }

  std::vector<size_t> UnsupportedPairs(
      SequenceMode sequence = SequenceMode::kNo) const {
    const FramePairIndex index(scene_, view_graph_, sequence);
    const PairFilteringOptions options;
    Mask is_explained(view_graph_.pairs.size(), false);
    for (const size_t i : explained_) is_explained[i] = true;
    const Mask is_unsupported = FindUnsupportedBridges(
        {scene_, index, view_graph_, is_consistent_, options}, is_explained);
    std::vector<size_t> unsupported;
    for (size_t i = 0; i < is_unsupported.size(); ++i) {
      if (is_unsupported[i]) unsupported.push_back(i);
    }
    return unsupported;
  }

 private:
  size_t AddPair(int frame1, int frame2, uint32_t begin_point,
                 uint32_t end_point, bool is_consistent) {
    ImagePair pair;
    pair.image_idx1 = frame1;
    pair.image_idx2 = frame2;
    pair.relative_pose = RelativePose{Eigen::Quaterniond::Identity(), {}};
    for (uint32_t point = begin_point; point < end_point; ++point) {
      pair.matches.push_back({point, point});
    }
    view_graph_.pairs.push_back(pair);
    is_consistent_.push_back(is_consistent);
    return view_graph_.pairs.size() - 1;
  }

  Scene scene_;
  ViewGraph view_graph_;
  Mask is_consistent_;
  Pairs explained_;
  uint32_t num_points_ = 0;
};

TEST(UnsupportedBridges, AreContradictedByComparablePairs) {
  Graph graph(8);
  graph.AddPlace(0, 4);
  graph.AddPlace(4, 8);
  const size_t bridge = graph.AddPair(1, 6, 40);
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{});  // no pair contradicts it
  graph.AddPair(2, 3, 50, false);                // this one is within a place
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{});
  graph.AddPair(0, 7, 15, false);
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{});  // too few matches
  graph.AddPair(3, 4, 15, false);
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{bridge});
}

TEST(UnsupportedBridges, AreNotContradictedByObjects) {
  Graph graph(8);
  graph.AddPlace(0, 4);
  graph.AddPlace(4, 8);
  const size_t bridge = graph.AddPair(1, 6, 40);
  const size_t object = graph.AddPair(0, 7, 60, false);
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{bridge});
  graph.Explain(object);
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{});
}

TEST(UnsupportedBridges, AreTheOnlyConnection) {
  Graph graph(8);
  graph.AddPlace(0, 4);
  graph.AddPlace(4, 8);
  graph.AddPair(1, 6, 40);
  graph.AddPair(2, 5, 20);  // agrees
  graph.AddPair(0, 7, 60, false);
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{});
}

TEST(UnsupportedBridges, AreNotInChainsOfNeighbors) {
  Graph graph(12);
  for (int f = 0; f + 1 < 12; ++f) graph.AddPair(f, f + 1, 40);
  graph.AddPair(2, 9, 60, false);
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{});
}

TEST(UnsupportedBridges, CanFollowEachOther) {
  Graph graph(9);
  graph.AddPlace(0, 4);
  graph.AddPlace(5, 9);
  const size_t first = graph.AddPair(3, 4, 40);
  const size_t second = graph.AddPair(4, 5, 40);
  graph.AddPair(1, 7, 30, false);
  EXPECT_EQ(graph.UnsupportedPairs(), (Pairs{first, second}));
}

TEST(UnsupportedBridges, MustNotBeLoopsOfASequence) {
  Graph graph(30);
  graph.AddPlace(0, 15);
  graph.AddPlace(15, 30);
  const size_t loop = graph.AddPair(1, 28, 40);
  EXPECT_EQ(graph.UnsupportedPairs(), Pairs{});  // no pair contradicts it
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kYes), Pairs{loop});
}

TEST(UnsupportedBridges, MayConnectNeighborsOfASequence) {
  Graph graph(30);
  graph.AddPlace(0, 15);
  graph.AddPlace(15, 30);
  graph.AddPair(14, 15, 20);
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kYes), Pairs{});
}

TEST(UnsupportedBridges, AreNotContradictedByLoopsOfASequence) {
  Graph graph(30);
  graph.AddPlace(0, 15);
  graph.AddPlace(15, 30);
  const size_t neighbors = graph.AddPair(13, 15, 20);
  for (int f = 0; f < 10; ++f) graph.AddPair(f, 29 - f, 40, false);
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kYes), Pairs{});
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kNo), Pairs{neighbors});
}

TEST(UnsupportedBridges, MayNotBeLoopsOfOnePlace) {
  Graph graph(40);
  graph.AddPath(0, 20);
  graph.AddPath(20, 40);
  const size_t loop = graph.AddLoop(5, 30);
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kYes),
            (Pairs{loop - 1, loop}));
  graph.AddLoop(6, 31);  // the same place
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kYes).size(), 4U);
  graph.AddLoop(15, 38);
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kYes), Pairs{});
}

// Where a vehicle hides the scene, frames next to each other share no pair.
TEST(UnsupportedBridges, MayNotBeLoopsOfFramesWithinReach) {
  Graph graph(40);
  graph.AddPath(0, 20);
  graph.AddPath(20, 40);
  graph.AddLoop(5, 30);
  graph.AddLoop(7, 32);
  for (const int frame : {5, 6}) {
    graph.Reject(frame, 7);
    graph.Reject(frame, 8);
  }
  graph.Reject(30, 32);
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kYes).size(), 4U);
}

// Both parts show nothing else.
TEST(UnsupportedBridges, MayBeLoopsOfTheOnlyPlace) {
  Graph graph(30);
  graph.AddPlace(0, 12);
  graph.AddPlace(18, 30);
  graph.AddLoop(0, 29);
  EXPECT_EQ(graph.UnsupportedPairs(SequenceMode::kYes), Pairs{});
}

}  // namespace
}  // namespace mgsfm
