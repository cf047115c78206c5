// SPDX-License-Identifier: BSD-3-Clause
#include "tracks/track_selection.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <vector>

#include "mgsfm/base/mask.h"

namespace mgsfm::internal {
namespace {

class Selection {
 public:
  Selection(const ObservationGroups& candidates, size_t num_images)
      : candidates_(candidates),
        is_selected_(candidates.size(), false),
        num_tracks_of_image_(num_images, 0) {}

  // Selects the track if one of its images has fewer than `num_wanted` tracks.
  void SelectIfWanted(size_t track, int num_wanted) {
    if (is_selected_[track]) return;
    const Observation* begin = candidates_.begin(track);
    const Observation* end = candidates_.end(track);
    if (std::none_of(begin, end, [&](const Observation& observation) {
          return num_tracks_of_image_[observation.image_idx] < num_wanted;
        })) {
      return;
    }
    is_selected_[track] = true;
    for (const Observation* i = begin; i != end; ++i) {
      ++num_tracks_of_image_[i->image_idx];
    }
  }

  ObservationGroups Selected() const {
    ObservationGroups selected;
    for (size_t track = 0; track < candidates_.size(); ++track) {
      if (!is_selected_[track]) continue;
      selected.observations.insert(selected.observations.end(),
                                   candidates_.begin(track),
                                   candidates_.end(track));
      selected.FinishGroup();
    }
    return selected;
  }

 private:
  const ObservationGroups& candidates_;
  Mask is_selected_;
  std::vector<int> num_tracks_of_image_;
};

}  // namespace

ObservationGroups SelectTracks(const ObservationGroups& candidates,
                               size_t num_images, const TrackOptions& options) {
  std::vector<size_t> longest_first(candidates.size());
  std::iota(longest_first.begin(), longest_first.end(), size_t{0});
  std::stable_sort(longest_first.begin(), longest_first.end(),
                   [&](size_t a, size_t b) {
                     return candidates.length(a) > candidates.length(b);
                   });
  const size_t min_length = static_cast<size_t>(options.min_track_length);
  const int max_tracks = options.max_tracks_per_image > 0
                             ? options.max_tracks_per_image
                             : std::numeric_limits<int>::max();
  Selection selection(candidates, num_images);
  for (const size_t track : longest_first) {
    if (candidates.length(track) < min_length) break;
    selection.SelectIfWanted(track, max_tracks);
  }
  for (const size_t track : longest_first) {
    selection.SelectIfWanted(track, options.min_tracks_per_image);
  }
  return selection.Selected();
}

}  // namespace mgsfm::internal
