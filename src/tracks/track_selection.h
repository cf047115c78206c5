// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/tracks.h"
#include "mgsfm/tracks/track_establishment.h"

namespace mgsfm::internal {

// The tracks fit for averaging of the candidates, in their order.
ObservationGroups SelectTracks(const ObservationGroups& candidates,
                               size_t num_images, const TrackOptions& options);

}  // namespace mgsfm::internal
