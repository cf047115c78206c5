// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Fewer common points do not tie sensors: five determine a relative pose, so no
// other point would confirm a pose that a mismatch caused.
inline constexpr int kMinNumSensorTies = 5;

// Separates sensors that share few points. Two sensors are tied if both observe
// at least kMinNumSensorTies points; ties are transitive. Each point keeps the
// observations by the set of tied sensors that observes it most, and is removed
// if only one observation remains. The motion of the rig alone then determines
// the relative poses of sensors that are not tied. Cost: linear in the
// observations.
void SeparateUntiedSensors(const Scene& scene, Reconstruction* reconstruction);

}  // namespace mgsfm
