// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/contradicted_points.h"

#include <atomic>
#include <cstddef>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "bundle_adjustment/image_views.h"
#include "scene/point_lookup.h"

namespace mgsfm {
namespace {

// Per point: the matches of its observations that contradict it. Their number
// does not depend on the order in which threads count them.
std::vector<std::atomic<int>> CountContradictions(
    const Scene& scene, const ViewGraph& matches, double max_error_px,
    int num_threads, const Reconstruction& reconstruction) {
  const std::vector<ImageView> views = MakeImageViews(scene, reconstruction);
  const PointLookup lookup(scene, reconstruction);
  std::vector<std::atomic<int>> num_contradictions(
      reconstruction.points.size());
  const auto test = [&](int point_idx, const ImageView& view,
                        const Eigen::Vector2f& keypoint_px) {
    const double error_px =
        view.ReprojectionError(reconstruction.points[point_idx].point_in_world,
                               keypoint_px.cast<double>());
    if (error_px <= max_error_px) return;
    num_contradictions[point_idx].fetch_add(1, std::memory_order_relaxed);
  };
  ParallelFor(
      matches.pairs.size(), num_threads,
      [&](size_t i) {
        const ImagePair& pair = matches.pairs[i];
        const ImageView& view1 = views[pair.image_idx1];
        const ImageView& view2 = views[pair.image_idx2];
        if (!view1.is_registered || !view2.is_registered) return;
        const auto& keypoints1 = scene.images[pair.image_idx1].keypoints_px;
        const auto& keypoints2 = scene.images[pair.image_idx2].keypoints_px;
        for (const Match& m : pair.matches) {
          const auto p1 = lookup.Find(pair.image_idx1, m.keypoint_idx1);
          const auto p2 = lookup.Find(pair.image_idx2, m.keypoint_idx2);
          if (p1 == p2) continue;
          if (p1) test(*p1, view2, keypoints2[m.keypoint_idx2]);
          if (p2) test(*p2, view1, keypoints1[m.keypoint_idx1]);
        }
      },
      /*block_size=*/16);
  return num_contradictions;
}

}  // namespace

void RemoveContradictedPoints(const Scene& scene, const ViewGraph& matches,
                              double max_error_px, double min_match_share,
                              int num_threads, Reconstruction* reconstruction) {
  if (min_match_share <= 0.0) return;
  const auto num_contradictions = CountContradictions(
      scene, matches, max_error_px, num_threads, *reconstruction);
  std::vector<Point3D>& points = reconstruction->points;
  size_t num_kept = 0;
  for (size_t p = 0; p < points.size(); ++p) {
    const auto n = static_cast<double>(points[p].track.size());
    const double num_agreeing = n * (n - 1.0);
    if (num_agreeing <
        min_match_share * (num_agreeing + num_contradictions[p])) {
      continue;
    }
    if (num_kept != p) points[num_kept] = std::move(points[p]);
    ++num_kept;
  }
  points.resize(num_kept);
}

}  // namespace mgsfm
