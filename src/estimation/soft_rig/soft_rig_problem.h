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

// `expected` is S_s per image, nullopt for unregistered images; `sigmas`
// are per sensor of the scene.
struct DeviationPrior {
  const std::vector<std::optional<Rigid3>>& expected;
  const std::vector<DeviationSigma>& sigmas;
  double sigma_px = 1.0;
};

// Problem (1) of soft_rig.h as a rig problem in which every image is a sensor
// with a prior at its expected pose. The images of a frame therefore move with
// it even if the priors are tight. Frames are those of the scene.
BuiltProblem BuildSoftRigProblem(const Scene& scene, const Scene& separate,
                                 const SoftRigModel& model,
                                 const DeviationPrior& deviations,
                                 const BundleAdjustmentOptions& options,
                                 const BundlePriors& priors);

// Writes back frames, images, points and cameras. Images that are not in the
// problem get their expected pose.
void WriteBack(const BuiltProblem& soft, const Scene& scene,
               const std::vector<std::optional<Rigid3>>& expected,
               SoftRigModel* model);

// The sum of reprojection errors over the images of a sensor.
struct ErrorSums {
  double sum_px = 0.0;
  size_t num_observations = 0;

  double Mean() const {
    return num_observations > 0 ? sum_px / static_cast<double>(num_observations)
                                : 0.0;
  }
};

// Per sensor.
std::vector<ErrorSums> SumErrors(const Scene& scene,
                                 const Reconstruction& reconstruction);

// The pose of each image; nullopt if it is not registered.
std::vector<std::optional<Rigid3>> ImagePosesOf(const Scene& scene,
                                                const Reconstruction& model);

}  // namespace mgsfm
