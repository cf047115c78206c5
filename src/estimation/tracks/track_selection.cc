// SPDX-License-Identifier: BSD-3-Clause
#include "tracks/track_selection.h"

#include <limits>

#include "scene/track_coverage.h"

namespace mgsfm::internal {

ObservationGroups SelectTracks(const ObservationGroups& candidates,
                               size_t num_images, const TrackOptions& options) {
  TrackCoverage coverage(candidates, num_images);
  coverage.Select(static_cast<size_t>(options.min_track_length),
                  options.max_tracks_per_image > 0
                      ? options.max_tracks_per_image
                      : std::numeric_limits<int>::max());
  coverage.Select(0, options.min_tracks_per_image);
  ObservationGroups selected;
  for (size_t track = 0; track < candidates.size(); ++track) {
    if (!coverage.is_selected()[track]) continue;
    selected.observations.insert(selected.observations.end(),
                                 candidates.begin(track),
                                 candidates.end(track));
    selected.FinishGroup();
  }
  return selected;
}

}  // namespace mgsfm::internal
