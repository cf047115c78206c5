// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "mgsfm/base/mask.h"
#include "translation/track_points.h"

namespace mgsfm {
namespace {

TEST(TrackSelectionTest, SupportedTracksAreSelectedFirst) {
  ObservationGroups tracks;
  TrackPoints points;
  const auto add_track = [&](const std::vector<int>& image_idxs) {
    for (const int image_idx : image_idxs) {
      tracks.observations.push_back({image_idx, 0});
      points.observation_is_used.push_back(true);
    }
    tracks.FinishGroup();
    points.point_in_world.emplace_back(Eigen::Vector3d::Zero());
  };
  add_track({0, 2, 4});  // longer, but not supported
  add_track({0, 2});
  const Mask is_supported{false, true};
  const TrackRays rays{tracks, {}};
  EXPECT_EQ(SelectTracks(rays, points, is_supported, 8, 0),
            (std::vector<size_t>{0, 1}));
  // Only the first track sees image 4.
  EXPECT_EQ(SelectTracks(rays, points, is_supported, 8, 1),
            (std::vector<size_t>{0, 1}));
  points.observation_is_used[2] = false;
  EXPECT_EQ(SelectTracks(rays, points, is_supported, 8, 1),
            (std::vector<size_t>{1}));
}

}  // namespace
}  // namespace mgsfm
