// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/tracks/match_selection.h"

namespace mgsfm {

struct TrackOptions {
  Option<int> min_track_length{
      "min_track_length", 3, AtLeast(2), "images",
      "Minimum track length. Shorter tracks are only used in images with fewer "
      "than min_tracks_per_image tracks."};
  Option<int> min_tracks_per_image{
      "min_tracks_per_image", 50, AtLeast(0), "tracks",
      "Minimum number of tracks per image. Images with fewer also use shorter "
      "tracks, the longest first."};
  Option<int> max_tracks_per_image{
      "max_tracks_per_image", 0, AtLeast(0), "tracks",
      "Maximum number of tracks per image: a track is dropped if all its "
      "images have that many longer ones; 0 keeps all. Set it to save time and "
      "memory."};
  Option<double> max_duplicate_distance_px{
      "max_duplicate_distance_px", 3.0, AtLeast(0.0), "px",
      "Maximum distance of two keypoints of an image that count as one feature "
      "detected twice. More distant keypoints of one image in a track are a "
      "conflict and split it."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(min_track_length, min_tracks_per_image, max_tracks_per_image,
          max_duplicate_distance_px);
  }
};

struct TrackSummary {
  size_t num_components = 0;
  size_t num_components_with_conflicts = 0;  // two keypoints of one image
  size_t num_tracks = 0;                     // selected
  size_t num_observations = 0;               // of the selected tracks
  double mean_track_length = 0.0;
};

struct TrackResult {
  ObservationGroups estimate;
  TrackSummary summary;
};

// Concatenates the selected matches to track candidates: sets of keypoints with
// at most one keypoint per image.
//
// The sets are the connected components of the graph of keypoints and matches.
// A component with two keypoints of one image (a conflict) contains wrong
// matches. It is rebuilt match by match, in descending order of support, that
// is, of the number of keypoints matched to both ends, then of matches of the
// pair; matches that would cause a conflict are rejected. Of a feature detected
// twice in one image, the keypoint with the most matches is kept.
//
// Groups are ordered by their first observations. Cost: nearly linear in the
// number of matches; O(m log m + m n) in the worst case for a conflicting
// component of n keypoints and m matches.
[[nodiscard]] ObservationGroups EstablishCandidates(
    const Scene& scene, const ViewGraph& view_graph,
    const MatchSelection& selection, const TrackOptions& options,
    const Context& context);

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
