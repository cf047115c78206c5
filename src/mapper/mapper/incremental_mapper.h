// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"

namespace mgsfm {

// RunMapper() with incremental instead of global estimation
// (mgsfm/incremental/incremental_mapping.h). Lenses, verification of pairs, the
// final adjustment, seams, checks and the report are those of the mapper.
[[nodiscard]] MapperResult RunIncrementalMapper(const MapperInput& input,
                                                const MapperOptions& options,
                                                const Context& context);

}  // namespace mgsfm
