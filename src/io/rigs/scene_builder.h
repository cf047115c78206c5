// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
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

// Why the known poses in rigs cannot be in meters: rigs on ships and trucks are
// shorter than the bound, and baselines in millimeters exceed it. nullopt if
// they may be.
std::optional<std::string> WhyRigsAreNotMetric(const Scene& scene);

}  // namespace mgsfm
