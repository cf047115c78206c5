// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/scene/scene.h"
#include "rigs/rig_inference.h"

namespace mgsfm {

// Builds the scene in canonical order: merges equal cameras of a sensor,
// chooses reference sensors, drops sensors and frames without images. Throws
// Error if a sensor has two images in a frame, or images with different
// intrinsics.
Scene BuildScene(RigInput input, RigAssignment assignment,
                 const Context& context);

}  // namespace mgsfm
