// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "synthetic/road.h"
#include "synthetic/street_surfaces.h"

namespace mgsfm {

// Facades with gaps, parked cars, trees and poles along a road.
std::vector<Surface> BuildStreet(const Road& road, uint64_t seed);

// Puts copies of facades into other places, where they replace what was there.
// Both places are straight and apart, and no place is used twice; there may be
// too few to make `num_duplicates`.
std::vector<Duplicate> DuplicateFacades(const Road& road, int num_duplicates,
                                        uint64_t seed,
                                        std::vector<Surface>* surfaces);

}  // namespace mgsfm
