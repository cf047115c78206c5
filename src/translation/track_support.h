// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "translation/position_problem.h"
#include "translation/baseline_directions.h"
#include "translation/track_points.h"

namespace mgsfm {

// Tracks were joined by all matches, also those of pairs that have since been
// set aside. Where such a match made one track of two, points are wrong, and
// they tie together frames that have nothing to do with each other: some
// thousand such ties and the frame graph is no longer that of a drive, whose
// elimination is linear in its length, but one without small separators.
//
// Per track: whether the frames of its used observations are connected by pairs
// that are not kUnused. False for tracks without a point.
// Cost: O(n^2 log d) for a track of n frames with d neighbours; in parallel.
Mask FindSupportedTracks(const PositionProblem& problem,
                         const std::vector<BaselineDirection>& motions,
                         const Mask& pair_is_used,
                         const TrackRays& rays, const TrackPoints& points,
                         int num_threads);

}  // namespace mgsfm
