// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/road.h"
#include "simulator/street_surfaces.h"

namespace mgsfm {

// Facades with gaps, parked cars, trees and poles along a road.
std::vector<Surface> BuildStreet(const Road& road, uint64_t seed);

// Copies facades to other places, replacing existing surfaces. Both places are
// straight and apart from each other, and no place is used twice. There may be
// fewer than `num_duplicates` suitable places. Duplicates are near the
// preferred nodes of the road, in turn, where possible.
std::vector<Duplicate> DuplicateFacades(const Road& road, int num_duplicates,
                                        const std::vector<int>& preferred_nodes,
                                        uint64_t seed,
                                        std::vector<Surface>* surfaces);

}  // namespace mgsfm
