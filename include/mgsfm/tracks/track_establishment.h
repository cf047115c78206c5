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
  int min_track_length = 3;
  int min_tracks_per_image = 50;
  int max_tracks_per_image = 0;
  double max_duplicate_distance_px = 3.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("min_track_length", self.min_track_length, AtLeast(2), "images",
          "Shorter tracks are only used where an image has too few others.");
    visit("min_tracks_per_image", self.min_tracks_per_image, AtLeast(0),
          "tracks",
          "Images with fewer tracks get their shorter ones, too, the longest "
          "first.");
    visit("max_tracks_per_image", self.max_tracks_per_image, AtLeast(0),
          "tracks",
          "Tracks are left out if all of their images have so many longer "
          "ones; 0 keeps all.");
    visit("max_duplicate_distance_px", self.max_duplicate_distance_px,
          AtLeast(0.0), "px",
          "Keypoints of an image within this that are matched to the same "
          "point are one, detected twice; others make a track ambiguous and "
          "split it.");
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

// Joins the matches of the selection to candidates for tracks: sets of
// keypoints that are images of one point each, as far as matches can tell, with
// at most one keypoint of an image.
//
// Components are those of the graph of keypoints and matches. Where one holds
// two keypoints of an image, some of its matches are wrong: it is split into
// sets without such conflicts by joining its keypoints anew, match by match in
// the order of their support, that is, the number of keypoints that are matched
// to both ends (then the number of matches of the pair), and refusing the
// matches that would make a conflict. Of keypoints detected twice in one image,
// the one with the most matches stays.
//
// Groups are ordered by their first observations. Nearly linear in the number
// of matches; a conflicting component of n keypoints and m matches costs
// O(m log m + m n) at worst.
[[nodiscard]] ObservationGroups EstablishCandidates(
    const Scene& scene, const ViewGraph& view_graph,
    const MatchSelection& selection, const TrackOptions& options,
    const Context& context);

// Tracks that are fit for averaging, which knows no poses yet that could tell a
// wrong match: made as candidates are, but of confirmed matches only
// (confirmed_matches.h). Images with fewer than min_tracks_per_image of such
// tracks keep all their matches. Selected, longest first, as the options say,
// such that every image stays constrained. Components of the summary are those
// of the matches that are left.
[[nodiscard]] TrackResult EstablishTracks(const Scene& scene,
                                          const ViewGraph& view_graph,
                                          const Mask& pair_is_used,
                                          const TrackOptions& options,
                                          const Context& context);

}  // namespace mgsfm
