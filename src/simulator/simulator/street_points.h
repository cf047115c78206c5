// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "simulator/world.h"

namespace mgsfm {

// Generates World::points from its road and surfaces.
std::vector<WorldPoint> FindStreetPoints(
    const SimulationOptions& options, const std::vector<SimulatedCamera>& rig,
    const Drive& drive, const World& world, const Context& context);

}  // namespace mgsfm
