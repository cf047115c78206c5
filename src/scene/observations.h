// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>

#include "mgsfm/scene/estimates.h"

namespace mgsfm {

size_t NumObservations(const Reconstruction& reconstruction);

// The mean over the observations of all points with a known error; nullopt if
// there are none.
std::optional<double> MeanReprojectionErrorPx(
    const Reconstruction& reconstruction);

}  // namespace mgsfm
