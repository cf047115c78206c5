// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/estimates.h"
#include "mgsfm/tracks/track_establishment.h"

namespace mgsfm::internal {

// Selects tracks by length such that every image has enough; see TrackOptions.
// Keeps the order of the candidates.
ObservationGroups SelectTracks(const ObservationGroups& candidates,
                               size_t num_images, const TrackOptions& options);

}  // namespace mgsfm::internal
