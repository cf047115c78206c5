// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/long_tracks.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "base/ranges.h"
#include "math/union_find.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

size_t NumFrames(const Scene& scene, const Point3D& point) {
  std::vector<int> frame_idxs =
      Transformed(point.track, [&](const Observation& o) {
        return scene.images[o.image_idx].frame_idx;
      });
  SortUnique(&frame_idxs);
  return frame_idxs.size();
}

bool AreConnected(const std::vector<Observation>& track, UnionFind* forest) {
  const size_t root = forest->Find(track.front().image_idx);
  return AllOf(track, [&](const Observation& o) {
    return forest->Find(o.image_idx) == root;
  });
}

}  // namespace

std::vector<Point3D> TakeShortTracks(const Scene& scene,
                                     const LongTrackOptions& options,
                                     std::vector<Point3D>* points) {
  const std::vector<size_t> num_frames = Transformed(
      *points, [&](const Point3D& point) { return NumFrames(scene, point); });
  std::vector<size_t> longest_first = Indices<size_t>(points->size());
  StableSortDescendingBy(&longest_first,
                         [&](size_t p) { return num_frames[p]; });
  std::vector<UnionFind> forests(options.num_per_cut,
                                 UnionFind(scene.images.size()));
  std::vector<size_t> num_of_image(scene.images.size(), 0);
  Mask remains(points->size(), false);
  for (const size_t p : longest_first) {
    const std::vector<Observation>& track = (*points)[p].track;
    // Images that a forest connects are connected in all earlier forests.
    const auto forest = std::partition_point(
        forests.begin(), forests.end(),
        [&](UnionFind& earlier) { return AreConnected(track, &earlier); });
    remains[p] =
        forest != forests.end() || AnyOf(track, [&](const Observation& o) {
          return num_of_image[o.image_idx] < options.num_per_image;
        });
    if (!remains[p]) continue;
    for (const Observation& o : track) {
      ++num_of_image[o.image_idx];
      if (forest == forests.end()) continue;
      forest->Union(track.front().image_idx, o.image_idx);
    }
  }
  std::vector<Point3D> long_tracks, short_tracks;
  for (size_t p = 0; p < points->size(); ++p) {
    (remains[p] ? long_tracks : short_tracks)
        .push_back(std::move((*points)[p]));
  }
  *points = std::move(long_tracks);
  return short_tracks;
}

}  // namespace mgsfm
