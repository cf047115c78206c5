// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "translation/position_initialization.h"
#include "translation/track_points.h"

namespace mgsfm {

// Positions that know nothing: frame centres and points uniform in a cube of
// 200, free internal translations in one of 2, as global positioning starts.
// Placed are the frames that tracks of two images or more see; those have
// points, and all their rays are used.
struct RandomStart {
  InitialPositions initial;
  TrackPoints points;
};

RandomStart StartAtRandom(const PositionProblem& problem, const TrackRays& rays,
                          uint64_t seed);

}  // namespace mgsfm
