// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "tracks/match_graph.h"

namespace mgsfm::internal {

// Splits the sorted observations of a component into sets of at least two
// images with at most one keypoint per image; see EstablishCandidates. Sets are
// ordered by their first observations.
ObservationGroups SplitComponent(const Scene& scene,
                                 const Observation* observations,
                                 size_t num_observations,
                                 const ComponentMatch* matches,
                                 size_t num_matches,
                                 double max_duplicate_distance_px);

}  // namespace mgsfm::internal
