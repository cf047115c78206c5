// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/bundle/bundle_priors.h"
#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Gives the images of an adjusted model poses of their own, and says in the log
// how rigid the cameras were. Whether it could be done.
bool EstimateSoftRigOfModel(const Scene& scene, const Scene& separate,
                            const CandidateSource& candidates,
                            const MapperOptions& options,
                            const BundlePriors& priors, const Context& context,
                            MapperModel* model);

}  // namespace mgsfm
