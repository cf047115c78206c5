// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mapper/mapper_recipe.h"
#include "mapper/pair_judgement.h"
#include "mapper/verified_pairs.h"
#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"

namespace mgsfm {

// Extends the existing model of the input as
// mgsfm/registration/model_extension.h describes; `selected` is null if the
// pairs are all pairs of the scene. Adds to the result the
// model, the reason for every frame that could not be added, and the sensors of
// the rotation summary. Throws Error if frames are to be fixed although
// position priors or a soft rig would move them.
void ExtendModel(const MapperRunInput& run, const PairsOfExtension* selected,
                 VerifiedPairs* pairs, MapperResult* result);

// Why a frame could not be registered.
[[nodiscard]] std::string ReasonForRejection(const ResectedFrame& frame,
                                             const ResectionOptions& options);

// Describes for each sensor where its pose comes from, in the summaries of the
// report. `start` has the poses of sensors from earlier models.
void DescribeSensors(const Scene& scene, const Reconstruction& start,
                     const std::vector<PlacedSensor>& placed,
                     MapperModel* model, MapperResult* result);

}  // namespace mgsfm
