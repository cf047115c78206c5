// SPDX-License-Identifier: BSD-3-Clause
#include "translation/track_support.h"

#include <gtest/gtest.h>

#include "math/graph.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/random.h"

namespace mgsfm {
namespace {

// Two images a frame; image 2 f and 2 f + 1 are of frame f.
struct Drive {
  explicit Drive(int num_frames) {
    problem.num_frames = num_frames;
    for (int image = 0; image < 2 * num_frames; ++image) {
      problem.frame_idx.push_back(image / 2);
      problem.sensor_idx.push_back(image % 2);
    }
  }
  void AddPair(int image_idx1, int image_idx2,
               BaselineKind kind = BaselineKind::kDirection) {
    BaselineDirection motion;
    motion.image_idx1 = image_idx1;
    motion.image_idx2 = image_idx2;
    motion.kind = kind;
    motions.push_back(motion);
  }
  void AddTrack(const std::vector<int>& image_idxs) {
    for (const int image_idx : image_idxs) {
      tracks.observations.push_back({image_idx, 0});
      points.observation_is_used.push_back(true);
    }
    tracks.FinishGroup();
    points.point_in_world.emplace_back(Eigen::Vector3d::Zero());
  }
  Mask Supported(int num_threads = 1) const {
    return FindSupportedTracks(problem, motions, rays, points, num_threads);
  }

  PositionProblem problem;
  std::vector<BaselineDirection> motions;
  ObservationGroups tracks;
  TrackRays rays{tracks, {}, {}};
  TrackPoints points;
};

TEST(TrackSupportTest, TracksHoldTogetherByPairsOrNot) {
  Drive drive(6);
  drive.AddPair(0, 2);
  drive.AddPair(3, 4, BaselineKind::kNoParallax);
  drive.AddPair(8, 10);
  drive.AddPair(4, 8, BaselineKind::kUnused);
  drive.AddTrack({0, 1});         // one frame
  drive.AddTrack({0, 3});         // of joined frames, other cameras
  drive.AddTrack({0, 2, 4});      // a chain
  drive.AddTrack({0, 4});         // joined only by a frame that does not see it
  drive.AddTrack({4, 8});         // by a pair that was set aside
  drive.AddTrack({2, 4, 8, 10});  // two tracks that a wrong match joined
  drive.AddTrack({2, 4, 8});
  drive.points.observation_is_used.back() = false;
  drive.AddTrack({0, 2});
  drive.points.point_in_world.back().reset();
  EXPECT_EQ(drive.Supported(), (Mask{1, 1, 1, 0, 0, 0, 1, 0}));
}

TEST(TrackSupportTest, AgreesWithPartsOfTheWholeGraph) {
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
    for (const BaselineDirection& motion : drive.motions) {
      const int frame1 = motion.image_idx1 / 2, frame2 = motion.image_idx2 / 2;
      if (is_seen[frame1] && is_seen[frame2]) edges.push_back({frame1, frame2});
    }
    const ConnectedComponents parts =
        FindConnectedComponents(kNumFrames, edges);
    int part = -1;
    bool is_one_part = true;
    for (int f = 0; f < kNumFrames; ++f) {
      if (!is_seen[f]) continue;
      is_one_part = is_one_part && (part < 0 || part == parts.component[f]);
      part = parts.component[f];
    }
    expected.push_back(is_one_part);
  }
  EXPECT_EQ(drive.Supported(), expected);
  EXPECT_EQ(drive.Supported(3), expected);
}

TEST(TrackSupportTest, SupportedTracksAreSelectedFirst) {
  Drive drive(4);
  drive.AddPair(0, 2);
  drive.AddTrack({0, 2, 4});  // longer, but not supported
  drive.AddTrack({0, 2});
  const Mask is_supported = drive.Supported();
  EXPECT_EQ(SelectTracks(drive.rays, drive.points, is_supported, 8, 0),
            (std::vector<size_t>{0, 1}));
  // Only the first track sees image 4.
  EXPECT_EQ(SelectTracks(drive.rays, drive.points, is_supported, 8, 1),
            (std::vector<size_t>{0, 1}));
  drive.points.observation_is_used[2] = false;
  EXPECT_EQ(SelectTracks(drive.rays, drive.points, is_supported, 8, 1),
            (std::vector<size_t>{1}));
}

}  // namespace
}  // namespace mgsfm
