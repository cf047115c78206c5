// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "translation_averaging/position_initialization.h"
#include "translation_averaging/track_points.h"

namespace mgsfm {

// The start of global positioning (GLOMAP): frame centers and points are
// uniform in a cube of side 200, translations of free sensors in a cube of
// side 2. Tracks with at least two rays have a point, and all their rays are
// used; the frames that observe them are placed.
struct RandomStart {
  InitialPositions initial;
  TrackPoints points;
};

RandomStart StartAtRandom(const PositionProblem& problem, const TrackRays& rays,
                          uint64_t seed);

}  // namespace mgsfm
