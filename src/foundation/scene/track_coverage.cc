// SPDX-License-Identifier: BSD-3-Clause
#include "scene/track_coverage.h"

#include <algorithm>

#include "base/ranges.h"

namespace mgsfm {

TrackCoverage::TrackCoverage(const ObservationGroups& tracks, size_t num_images)
    : tracks_(tracks),
      longest_first_(Indices<size_t>(tracks.size())),
      is_selected_(tracks.size(), false),
      num_tracks_of_image_(num_images, 0) {
  StableSortDescendingBy(&longest_first_,
                         [&](size_t track) { return tracks.length(track); });
}

void TrackCoverage::Select(size_t min_length, int num_per_image) {
  for (const size_t track : longest_first_) {
    if (tracks_.length(track) < min_length) break;
    if (is_selected_[track]) continue;
    const Observation* begin = tracks_.begin(track);
    const Observation* end = tracks_.end(track);
    is_selected_[track] = std::any_of(begin, end, [&](const Observation& o) {
      return num_tracks_of_image_[o.image_idx] < num_per_image;
    });
    if (!is_selected_[track]) continue;
    num_observations_ += tracks_.length(track);
    for (const Observation* o = begin; o != end; ++o) {
      ++num_tracks_of_image_[o->image_idx];
    }
  }
}

ObservationGroups TrackCoverage::Selected() const {
  ObservationGroups selected;
  for (size_t track = 0; track < tracks_.size(); ++track) {
    if (!is_selected_[track]) continue;
    selected.AddGroup(tracks_.begin(track), tracks_.end(track));
  }
  return selected;
}

}  // namespace mgsfm
