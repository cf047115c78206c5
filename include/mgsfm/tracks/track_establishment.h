// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct TrackOptions {
  Option<int> min_track_length{
      "min_track_length", 3, AtLeast(2), "images",
      "Drop tracks of fewer images, except in images that have few tracks."};
  // Minimum number of tracks per image. Images with fewer also use shorter
  // tracks, the longest first.
  int min_tracks_per_image = 50;
  Option<int> max_tracks_per_image{
      "max_tracks_per_image", 0, AtLeast(0), "tracks",
      "Drop a track if all its images have this many longer tracks. 0 keeps "
      "all tracks. Set it to save time and memory."};
  // Maximum distance of two keypoints of an image that count as one feature
  // detected twice. More distant keypoints of one image in a track are a
  // conflict and split it.
  double max_duplicate_distance_px = 3.0;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(min_track_length, max_tracks_per_image);
  }
};

struct TrackSummary {
  size_t num_components = 0;
  size_t num_components_with_conflicts = 0;  // two keypoints of one image
  size_t num_tracks = 0;                     // selected
  size_t num_observations = 0;               // of the selected tracks
  double mean_track_length = 0.0;

  auto Fields() const {
    return Named("num_components", num_components,
                 "num_components_with_conflicts", num_components_with_conflicts,
                 "num_tracks", num_tracks, "num_observations", num_observations,
                 "mean_track_length", mean_track_length);
  }
};

struct TrackResult {
  ObservationGroups estimate;
  TrackSummary summary;
};

struct MatchSelectionOptions {
  // Minimum fraction of the matches between two frames that agree with their
  // poses; otherwise, all of them are rejected. Increase it for repeated
  // structures.
  double min_pair_share = 0.4;
};

// The used matches of a view graph.
struct MatchSelection {
  Mask pair_is_used;  // per pair
  // Per match, concatenated over all pairs; if empty, all matches of used pairs
  // are used.
  Mask match_is_used;
};

// Selects the matches that agree with the poses of `model`. Two keypoints agree
// if a point in front of both cameras projects to both, with a Sampson error of
// at most sqrt(2) max_error_px, the error of a pair of keypoints with errors of
// max_error_px each (geometry/epipolar.h). Cameras without baseline need rays
// of the same direction.
//
// A few wrong matches agree by chance, and a pair of images of different places
// may have hundreds of matches. Their short tracks pass all tests of single
// points, attract unrelated frames and cause fill-in of the frame system. All
// matches between two frames, over all cameras of the rig, are therefore judged
// together: none is used if fewer than min_pair_share of them agree.
//
// Pairs without pair_is_used and pairs with an image without pose are not used.
// Cost: linear in the number of matches.
struct MatchSelectionInput {
  const Scene& scene;
  const ViewGraph& view_graph;
  const Mask& pair_is_used;
  const Reconstruction& model;
};
[[nodiscard]] MatchSelection SelectConsistentMatches(
    const MatchSelectionInput& input, double max_error_px,
    const MatchSelectionOptions& options, const Context& context);

// Joins the selected matches into track candidates: sets of keypoints with at
// most one keypoint per image.
//
// The sets are the connected components of the graph of keypoints and matches.
// A component with two keypoints of one image (a conflict) contains wrong
// matches. It is rebuilt match by match, in descending order of support
// (keypoints matched to both ends; ties: matches of the pair); matches that
// would cause a conflict are rejected. If a feature was detected twice in one
// image, the keypoint with the most matches is kept.
//
// Sets are ordered by their first observations. Cost: nearly linear in the
// number of matches; O(m log m + m n) in the worst case for a conflicting
// component of n keypoints and m matches.
[[nodiscard]] ObservationGroups EstablishCandidates(
    const Scene& scene, const ViewGraph& view_graph,
    const MatchSelection& selection, const TrackOptions& options,
    const Context& context);

// Joins candidates with the points that observe one of their keypoints; other
// points follow if `with_others`. The points of a model stand for the matches
// that made them, so that only matches of new images need to be candidates.
[[nodiscard]] ObservationGroups JoinPoints(const Scene& scene,
                                           const ObservationGroups& candidates,
                                           const std::vector<Point3D>& points,
                                           bool with_others);

// Per pair, the number of matches whose keypoints observe the same point.
[[nodiscard]] std::vector<std::ptrdiff_t> CountMatchesOfPoints(
    const Scene& scene, const ViewGraph& view_graph,
    const std::vector<Point3D>& points);

// Tracks for averaging, before poses are known that could identify wrong
// matches. They are established like candidates, but from triplet-consistent
// matches only (pair_filtering/triplet_consistency.h). Images with fewer than
// min_tracks_per_image of these tracks keep all their matches. Tracks are
// selected by the options, the longest first, such that every image remains
// constrained. Components of the summary are those of the remaining matches.
[[nodiscard]] TrackResult EstablishTracks(const Scene& scene,
                                          const ViewGraph& view_graph,
                                          const Mask& pair_is_used,
                                          const TrackOptions& options,
                                          const Context& context);

}  // namespace mgsfm
