// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

#include "moving_objects/motion_candidates.h"

namespace mgsfm {

// Whether a competing motion has support and recurs in an adjacent step, as a
// hypothesis or by the matches there.
bool HasRivals(const Steps& steps, size_t k);

}  // namespace mgsfm
