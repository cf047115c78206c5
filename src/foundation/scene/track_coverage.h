// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// Selects tracks that cover all images, longest first: long tracks connect the
// most images per observation.
class TrackCoverage {
 public:
  // The tracks must outlive this object.
  TrackCoverage(const ObservationGroups& tracks, size_t num_images);

  // Also selects tracks of at least this length if an image of the track has
  // fewer than num_per_image selected tracks.
  void Select(size_t min_length, int num_per_image);

  const Mask& is_selected() const { return is_selected_; }
  // The selected tracks, in their order.
  ObservationGroups Selected() const;
  size_t num_observations() const { return num_observations_; }

 private:
  const ObservationGroups& tracks_;
  std::vector<size_t> longest_first_;
  Mask is_selected_;
  std::vector<int> num_tracks_of_image_;
  size_t num_observations_ = 0;  // of the selected tracks
};

}  // namespace mgsfm
