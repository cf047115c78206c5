// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"
#include "translation_averaging/position_estimation.h"

namespace mgsfm {

// The step from rotations to positions and points; EstimatePositions() in the
// mapper.
using PositionStep = std::function<PositionResult(
    const PositionInput& input, const PositionOptions& options,
    const Context& context)>;

// RunMapper() with another step, for comparisons with other methods.
[[nodiscard]] MapperResult RunMapperWith(const PositionStep& estimate_positions,
                                         const MapperInput& input,
                                         const MapperOptions& options,
                                         const Context& context);

}  // namespace mgsfm
