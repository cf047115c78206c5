// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "bundle_adjustment/problem_builder.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The standard deviation of each coordinate of the deviations of a sensor.
struct DeviationSigma {
  double rotation_rad = 0.0;
  double position = 0.0;
};

// A model with one pose per image.
struct SoftRigModel {
  Reconstruction rig;       // of the scene; its points are not used
  Reconstruction separate;  // of SeparateImages(scene)
};

// Problem (1) of soft_rig.h as a rig problem in which every image is a sensor
// with a prior at its expected pose. The images of a frame therefore move with
// it even if the priors are tight.
struct SoftRigProblem {
  BuiltProblem built;           // frame_idxs are those of the scene
  std::vector<int> image_idxs;  // per image and per sensor of the problem
};

// `expected` is S_s D_i per image, nullopt for unregistered images; `sigmas`
// are per sensor of the scene.
struct DeviationPrior {
  const std::vector<std::optional<Rigid3>>& expected;
  const std::vector<DeviationSigma>& sigmas;
  double sigma_px = 1.0;
};
SoftRigProblem BuildSoftRigProblem(const Scene& scene, const Scene& separate,
                                   const SoftRigModel& model,
                                   const DeviationPrior& deviations,
                                   const BundleAdjustmentOptions& options,
                                   const BundlePriors& priors);

// Writes back frames, images, points and cameras. Images that are not in the
// problem get their expected pose.
void WriteBack(const SoftRigProblem& soft, const Scene& scene,
               const std::vector<std::optional<Rigid3>>& expected,
               SoftRigModel* model);

// The deviation (w, d) of `pose` from `expected`, see soft_rig.h.
PoseVector DeviationOf(const Rigid3& pose, const Rigid3& expected);

}  // namespace mgsfm
