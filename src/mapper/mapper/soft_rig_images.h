// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mapper/model_adjustment.h"
#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/scene.h"
#include "soft_rig/rig_delays.h"

namespace mgsfm {

// Timestamps if all images have one; otherwise the order of the frames.
FrameTimes TimesOfFrames(const Scene& scene);

// Estimates individual poses for the images of an adjusted model, and logs how
// far the cameras deviate from a rigid rig.
void EstimateSoftRigOfModel(const AdjustmentInput& input, BundlePriors priors,
                            const MapperOptions& options,
                            const Context& context, MapperModel* model);

}  // namespace mgsfm
