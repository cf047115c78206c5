// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/selected_tracks.h"

#include <utility>
#include <vector>

#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/solve.h"
#include "mgsfm/base/mask.h"
#include "scene/observations.h"
#include "scene/track_coverage.h"

namespace mgsfm {
namespace {

// As many tracks of each image as the limit allows.
Mask SelectTracks(const ObservationGroups& tracks, size_t num_images,
                  size_t max_num_observations) {
  Mask selected(tracks.size(), false);
  int fits = 0, exceeds = 4096;  // tracks per image
  while (exceeds - fits > 1) {
    const int num_per_image = (fits + exceeds) / 2;
    TrackCoverage coverage(tracks, num_images);
    coverage.Select(0, num_per_image);
    if (coverage.num_observations() <= max_num_observations) {
      fits = num_per_image;
      selected = coverage.is_selected();
    } else {
      exceeds = num_per_image;
    }
  }
  return selected;
}

}  // namespace

BundleResult RefineBySelectedTracks(const Scene& scene, Reconstruction initial,
                                    const BundleAdjustmentOptions& options,
                                    size_t max_num_observations,
                                    const Context& context,
                                    const RefinementConditions& conditions) {
  std::vector<Point3D> points = std::exchange(initial.points, {});
  const Reconstruction poses = initial;
  ObservationGroups tracks = GroupTracks(points);
  const Mask is_selected =
      SelectTracks(tracks, scene.images.size(), max_num_observations);
  for (size_t p = 0; p < points.size(); ++p) {
    if (is_selected[p]) initial.points.push_back(points[p]);
  }
  const CandidateSource selected = FixedCandidates(GroupTracks(initial.points));
  BundleAdjustmentOptions solve = options;
  solve.saves_memory = true;
  BundleResult result = RefineReconstruction(
      scene, selected, std::move(initial), solve, context, conditions);
  result.estimate.points = std::move(points);
  BundleAdjustmentOptions last = options;
  last.max_max_error_px = result.summary.rounds.back().max_error_px;
  result.estimate =
      TriangulateCandidates(scene, FixedCandidates(std::move(tracks)),
                            std::move(result.estimate), last, context);
  ComputePointErrors(scene, context.num_threads, &result.estimate);
  FinishSummary(scene, poses, options, &result);
  return result;
}

}  // namespace mgsfm
