// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Fewer points than these tie no sensors: five determine a relative pose, so
// that no other point confirms one that a mismatch made.
inline constexpr int kMinNumSensorTies = 5;

// Separates sensors that few points tie. Two sensors are tied if at least
// kMinNumSensorTies points are observed by both, and so are all sensors that a
// chain of tied ones joins. Each point keeps its observations by those tied
// sensors that observe it most, and is removed if only one observation is left.
// The motion of the rig alone then determines the relative poses of sensors
// that are not tied. Cost: linear in the observations.
void SeparateUntiedSensors(const Scene& scene, Reconstruction* reconstruction);

}  // namespace mgsfm
