// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mapper/verified_pairs.h"
#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Checks an input against itself and against the result (mgsfm/input_check),
// and adds the findings to `result`, causes before their effects. The scene of
// the pairs has the cameras that the stages used. Lost matches are a finding
// only if no other finding explains them.
void CheckInput(const VerifiedPairs& pairs, const MapperInput& input,
                const MapperOptions& options, const Context& context,
                MapperResult* result);

// Reports estimated focal lengths that are uncertain, once per camera, unless
// the estimate agrees with the initial value, up to two of the largest relative
// standard deviations that count as certain.
void AddUncertainFocalLengths(const Scene& scene, double max_sigma,
                              MapperResult* result);

// Logs at most five findings, as warnings.
void LogFindings(const MapperResult& result, const Context& context);

}  // namespace mgsfm
