// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "pipeline/position_recipe.h"

namespace mgsfm {

// Positions by the inputs and objectives of the paper's ablation
// (mgsfm/translation/translation_averaging.h), in place of EstimatePositions().
[[nodiscard]] PositionResult EstimatePositionsByVariant(
    const PositionInput& input, const PositionOptions& options,
    const Context& context);

}  // namespace mgsfm
