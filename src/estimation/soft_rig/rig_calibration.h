// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "soft_rig/deviations.h"

namespace mgsfm {

// The expected pose S_s D_i of soft_rig.h per image; nullopt for unregistered
// images.
std::vector<std::optional<Rigid3>> ExpectedPoses(const Scene& scene,
                                                 const Reconstruction& rig);

// The derivative of the expected pose with respect to the pose of the sensor,
// in the coordinates of rig_problem.h.
SensorJacobian ExpectedPoseJacobian(const Scene& scene,
                                    const Reconstruction& rig, int image_idx);

// One generalized least squares step of the extrinsics of all rigs: the
// quantities of soft_rig.h that the images of a sensor share.
void UpdateExtrinsics(const Scene& scene,
                      const std::vector<FrameDeviations>& frames,
                      const std::vector<DeviationSigma>& sigmas,
                      const BundleAdjustmentOptions& options,
                      Reconstruction* rig);

}  // namespace mgsfm
