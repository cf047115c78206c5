// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/long_tracks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "base/random.h"
#include "base/ranges.h"

namespace mgsfm {
namespace {

constexpr int kNumImages = 8;

// Two images per frame.
Scene SmallScene() {
  Scene scene;
  for (int i = 0; i < kNumImages; ++i) {
    scene.images.push_back({ImageId(i + 1), "", 0, 0, i / 2, {}});
  }
  return scene;
}

Point3D PointSeenBy(const std::vector<int>& image_idxs, int keypoint_idx) {
  Point3D point;
  for (const int i : image_idxs) point.track.push_back({i, keypoint_idx});
  return point;
}

// Tracks of random images, most of them short.
std::vector<Point3D> RandomPoints(int num_points, Random* random) {
  std::vector<Point3D> points;
  for (int p = 0; p < num_points; ++p) {
    const double share = random->Uniform(0.15, 0.6);
    std::vector<int> image_idxs;
    for (int i = 0; i < kNumImages; ++i) {
      if (random->Uniform() < share) image_idxs.push_back(i);
    }
    if (image_idxs.size() < 2) {
      image_idxs = {p % kNumImages, (p + 3) % kNumImages};
    }
    points.push_back(PointSeenBy(image_idxs, p));
  }
  return points;
}

std::vector<std::vector<Observation>> TracksOf(
    const std::vector<Point3D>& points, const std::vector<Point3D>& others) {
  std::vector<std::vector<Observation>> tracks;
  for (const auto* list : {&points, &others}) {
    for (const Point3D& point : *list) tracks.push_back(point.track);
  }
  std::sort(tracks.begin(), tracks.end());
  return tracks;
}

std::vector<Point3D> LongTracks(const std::vector<Point3D>& all,
                                size_t num_per_cut, size_t num_per_image = 0) {
  std::vector<Point3D> points = all;
  const auto taken =
      TakeShortTracks(SmallScene(), {num_per_cut, num_per_image}, &points);
  EXPECT_EQ(TracksOf(points, taken), TracksOf(all, {}));
  return points;
}

size_t NumAcross(const std::vector<Point3D>& points, unsigned images_of_side) {
  return static_cast<size_t>(CountIf(points, [&](const Point3D& point) {
    const auto is_on_side = [&](const Observation& o) {
      return (images_of_side >> o.image_idx & 1U) != 0;
    };
    return AnyOf(point.track, is_on_side) && !AllOf(point.track, is_on_side);
  }));
}

TEST(TakeShortTracksTest, EachCutKeepsItsTracksUpToTheLimit) {
  Random random(1);
  for (const size_t num_per_cut : {1, 3, 10}) {
    for (const int num_points : {5, 30, 200}) {
      const std::vector<Point3D> all = RandomPoints(num_points, &random);
      const auto remaining = LongTracks(all, num_per_cut);
      for (unsigned side = 1; side < (1U << kNumImages) - 1; ++side) {
        EXPECT_GE(NumAcross(remaining, side),
                  std::min(NumAcross(all, side), num_per_cut))
            << num_per_cut << " tracks, side " << side;
      }
    }
  }
}

// A forest of n images has at most n - 1 connections.
TEST(TakeShortTracksTest, TheRestDoesNotGrowWithTheNumberOfTracks) {
  Random random(2);
  const auto remaining = LongTracks(RandomPoints(2000, &random), 10);
  EXPECT_LE(remaining.size(), 10 * (kNumImages - 1));
}

// The first track has the most images, but of two frames only.
TEST(TakeShortTracksTest, TracksOfMoreFramesComeFirst) {
  const std::vector<Point3D> points = {
      PointSeenBy({0, 1, 2, 3}, 0), PointSeenBy({0, 2, 4}, 1),
      PointSeenBy({1, 3, 5}, 2), PointSeenBy({0, 3, 6}, 3)};
  const auto remaining = LongTracks(points, 1);
  ASSERT_EQ(remaining.size(), 3u);
  for (size_t i = 0; i < remaining.size(); ++i) {
    EXPECT_EQ(remaining[i].track, points[i + 1].track);
  }
}

TEST(TakeShortTracksTest, EachImageKeepsItsTracksUpToTheLimit) {
  Random random(3);
  const std::vector<Point3D> all = RandomPoints(200, &random);
  const auto remaining = LongTracks(all, 1, 15);
  EXPECT_LT(remaining.size(), all.size() / 2);
  for (int i = 0; i < kNumImages; ++i) {
    const auto num_of = [&](const std::vector<Point3D>& points) {
      return CountIf(points, [&](const Point3D& point) {
        return AnyOf(point.track,
                     [&](const Observation& o) { return o.image_idx == i; });
      });
    };
    EXPECT_GE(num_of(remaining), std::min<std::ptrdiff_t>(15, num_of(all)));
  }
}

}  // namespace
}  // namespace mgsfm
