// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct TrackOptions {
  int min_track_length = 3;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("min_track_length", self.min_track_length, AtLeast(2), "images",
          "Shorter tracks are only used where an image has too few others.");
  }
};

struct TrackSummary {
  size_t num_components = 0;
  size_t num_components_with_conflicts = 0;
  size_t num_tracks = 0;
  size_t num_observations = 0;
  double mean_track_length = 0.0;
};

struct TrackResult {
  Tracks estimate;
  TrackSummary summary;
};

// Uses the matches of the pairs with pair_is_used[pair_idx].
[[nodiscard]] TrackResult EstablishTracks(const Scene& scene,
                                          const ViewGraph& view_graph,
                                          const std::vector<char>& pair_is_used,
                                          const TrackOptions& options,
                                          const Context& context);

}  // namespace mgsfm
