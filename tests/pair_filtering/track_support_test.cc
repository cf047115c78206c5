// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/track_support.h"

#include <gtest/gtest.h>

#include <optional>

#include "base/random.h"
#include "math/graph.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// Two images per frame: 2 f and 2 f + 1 belong to frame f.
struct Drive {
  explicit Drive(int num_frames) {
    for (int image = 0; image < 2 * num_frames; ++image) {
      scene.images.push_back(
          {ImageId(static_cast<uint32_t>(image + 1)), "", 0, 0, image / 2, {}});
    }
    for (int f = 0; f < num_frames; ++f) {
      scene.frames.push_back(
          {FrameId(static_cast<uint32_t>(f + 1)), "", 0, {2 * f, 2 * f + 1}});
    }
  }
  void AddPair(int image_idx1, int image_idx2, bool is_accepted = true) {
    ImagePair pair;
    pair.image_idx1 = image_idx1;
    pair.image_idx2 = image_idx2;
    view_graph.pairs.push_back(pair);
    pair_is_accepted.push_back(is_accepted);
  }
  void AddTrack(const std::vector<int>& image_idxs) {
    for (const int image_idx : image_idxs) {
      tracks.observations.push_back({image_idx, 0});
      observation_is_used.push_back(true);
    }
    tracks.FinishGroup();
    track_is_used.push_back(true);
  }
  Mask Supported(int num_threads = 1) const {
    return FindSupportedTracks(scene, FramePairIndex(scene, view_graph),
                               pair_is_accepted, tracks, track_is_used,
                               observation_is_used, num_threads);
  }

  Scene scene;
  ViewGraph view_graph;
  Mask pair_is_accepted;
  ObservationGroups tracks;
  Mask track_is_used;
  Mask observation_is_used;
};

TEST(TrackSupportTest, AcceptedPairsConnectTheFramesOfATrack) {
  Drive drive(6);
  drive.AddPair(0, 2);
  drive.AddPair(3, 4);
  drive.AddPair(8, 10);
  drive.AddPair(4, 8, false);
  drive.AddTrack({0, 1});         // one frame
  drive.AddTrack({0, 3});         // connected frames, other cameras
  drive.AddTrack({0, 2, 4});      // a chain
  drive.AddTrack({0, 4});         // connected only by a frame without the track
  drive.AddTrack({4, 8});         // connected by a rejected pair
  drive.AddTrack({2, 4, 8, 10});  // two tracks that a wrong match merged
  drive.AddTrack({2, 4, 8});
  drive.observation_is_used.back() = false;
  drive.AddTrack({0, 2});
  drive.track_is_used.back() = false;
  EXPECT_EQ(drive.Supported(), (Mask{1, 1, 1, 0, 0, 0, 1, 0}));
}

TEST(TrackSupportTest, AgreesWithComponentsOfTheWholeGraph) {
  constexpr int kNumFrames = 40;
  Drive drive(kNumFrames);
  Random random(3);
  const auto any = [&random](uint32_t size) {
    return static_cast<int>(random.Index(size));
  };
  for (int k = 0; k < 90; ++k) {
    drive.AddPair(any(2 * kNumFrames), any(2 * kNumFrames));
  }
  for (int t = 0; t < 500; ++t) {
    std::vector<int> image_idxs(2 + any(8));
    for (int& i : image_idxs) i = any(2 * kNumFrames);
    drive.AddTrack(image_idxs);
  }
  Mask expected;
  for (size_t t = 0; t < drive.tracks.size(); ++t) {
    Mask is_seen(kNumFrames, false);
    for (size_t k = drive.tracks.offsets[t]; k < drive.tracks.offsets[t + 1];
         ++k) {
      is_seen[drive.tracks.observations[k].image_idx / 2] = true;
    }
    std::vector<GraphEdge> edges;
    for (const ImagePair& pair : drive.view_graph.pairs) {
      const int frame1 = pair.image_idx1 / 2, frame2 = pair.image_idx2 / 2;
      if (is_seen[frame1] && is_seen[frame2]) edges.push_back({frame1, frame2});
    }
    const std::vector<int> component =
        FindConnectedComponents(kNumFrames, edges).component;
    std::optional<int> first;
    bool is_connected = true;
    for (int f = 0; f < kNumFrames; ++f) {
      if (!is_seen[f]) continue;
      if (!first) first = component[f];
      is_connected = is_connected && component[f] == *first;
    }
    expected.push_back(is_connected);
  }
  EXPECT_EQ(drive.Supported(), expected);
  EXPECT_EQ(drive.Supported(3), expected);
}

}  // namespace
}  // namespace mgsfm
