// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "bundle/problem_builder.h"
#include "least_squares/rig_problem.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/bundle/bundle_priors.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Standard deviations of each coordinate of the deviations of a sensor.
struct Spread {
  double rotation_rad = 0.0;
  double position = 0.0;
};

// A model whose images have poses of their own.
struct LooseModel {
  Reconstruction rig;       // of the scene; its points are not used
  Reconstruction separate;  // of SeparateImages(scene)
};

// The problem (1) of soft_rig.h. In it, every image is a sensor of
// its own, with a prior at where the rig has it; so the images of a frame move
// with it, however narrow their priors are.
struct SoftRigProblem {
  BuiltProblem built;           // frame_idxs are those of the scene
  std::vector<int> image_idxs;  // of the images, and of the sensors
};

// `expected`: per image, where the rig has it in its frame. Spreads are per
// sensor of the scene.
SoftRigProblem BuildLooseProblem(
    const Scene& scene, const Scene& separate, const LooseModel& model,
    const std::vector<std::optional<Rigid3>>& expected,
    const std::vector<Spread>& spreads, double sigma_px,
    const BundleAdjustmentOptions& options, const BundlePriors& priors);

// Frames, images, points and cameras; images that are not in the problem get
// the expected pose.
void WriteBack(const SoftRigProblem& loose, const Scene& scene,
               const std::vector<std::optional<Rigid3>>& expected,
               LooseModel* model);

// Changes of a sensor (rig_problem.h) from `expected` to `pose`.
PoseVector DeviationOf(const Rigid3& pose, const Rigid3& expected);

}  // namespace mgsfm
