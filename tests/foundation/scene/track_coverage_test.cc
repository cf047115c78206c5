// SPDX-License-Identifier: BSD-3-Clause
#include "scene/track_coverage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "base/random.h"

namespace mgsfm {
namespace {

constexpr int kNumImages = 12;

ObservationGroups RandomTracks() {
  Random random(3);
  ObservationGroups tracks;
  for (int t = 0; t < 200; ++t) {
    for (int i = 0; i < kNumImages; ++i) {
      if (random.Uniform() < 0.3) tracks.observations.push_back({i, t});
    }
    tracks.FinishGroup();
  }
  return tracks;
}

std::vector<int> CountPerImage(const ObservationGroups& tracks,
                               const Mask& is_counted) {
  std::vector<int> counts(kNumImages, 0);
  for (size_t t = 0; t < tracks.size(); ++t) {
    if (!is_counted[t]) continue;
    for (const Observation* o = tracks.begin(t); o != tracks.end(t); ++o) {
      ++counts[o->image_idx];
    }
  }
  return counts;
}

TEST(TrackCoverageTest, EachImageHasEnoughOfTheLongestTracks) {
  const ObservationGroups tracks = RandomTracks();
  TrackCoverage coverage(tracks, kNumImages);
  constexpr int kNumPerImage = 10;
  coverage.Select(0, kNumPerImage);
  const Mask& is_selected = coverage.is_selected();
  const std::vector<int> counts = CountPerImage(tracks, is_selected);
  EXPECT_GE(*std::min_element(counts.begin(), counts.end()), kNumPerImage);
  size_t sum = 0;
  for (const int count : counts) sum += static_cast<size_t>(count);
  EXPECT_EQ(coverage.num_observations(), sum);
  // A track that is left out has no image that longer tracks do not cover.
  for (size_t t = 0; t < tracks.size(); ++t) {
    if (is_selected[t]) continue;
    Mask is_longer(tracks.size(), false);
    for (size_t k = 0; k < tracks.size(); ++k) {
      is_longer[k] = is_selected[k] && tracks.length(k) >= tracks.length(t);
    }
    const std::vector<int> of_longer = CountPerImage(tracks, is_longer);
    for (const Observation* o = tracks.begin(t); o != tracks.end(t); ++o) {
      EXPECT_GE(of_longer[o->image_idx], kNumPerImage);
    }
  }
}

TEST(TrackCoverageTest, ShortTracksFillImagesThatLongOnesLeave) {
  ObservationGroups tracks;
  tracks.observations = {{0, 0}, {1, 0}, {2, 0}, {0, 1},
                         {1, 1}, {2, 1}, {3, 0}};
  tracks.offsets = {0, 3, 5, 7};
  TrackCoverage coverage(tracks, 4);
  coverage.Select(3, 5);
  EXPECT_EQ(coverage.num_observations(), 3u);
  coverage.Select(0, 1);
  EXPECT_TRUE(coverage.is_selected()[0]);
  EXPECT_FALSE(coverage.is_selected()[1]);
  EXPECT_TRUE(coverage.is_selected()[2]);
}

}  // namespace
}  // namespace mgsfm
