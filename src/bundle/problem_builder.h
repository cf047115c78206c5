// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "bundle/bundle_problem.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The bundle problem of a reconstruction, and the way back.
struct BuiltProblem {
  BundleProblem problem;
  BundleState state;
  // Positions in the scene, or in Reconstruction::points, of what is in the
  // problem: only what has observations in it.
  std::vector<int> frame_idxs;
  std::vector<int> sensor_idxs;
  std::vector<int> camera_idxs;
  std::vector<int> point_idxs;
  size_t num_invisible_observations = 0;
};

enum class RefinedParts {
  kAll,
  kTranslations,  // rotations and intrinsics are held
};

BuiltProblem BuildProblem(const Scene& scene,
                          const Reconstruction& reconstruction,
                          const BundleAdjustmentOptions& options,
                          RefinedParts parts, const BundlePriors& priors = {},
                          const FixedPoses& held = {});

// Which coordinates of the pose of a sensor are refined, and the prior on it,
// if it was given; in this, `sensor` is its position in the scene.
struct RefinedSensor {
  PoseMask mask = PoseMask::Zero();
  std::optional<SensorPrior> prior;
};

RefinedSensor RefineSensor(const Scene& scene, int sensor_idx,
                           const BundleAdjustmentOptions& options);

// Whether the focal length of a camera of the scene is refined.
bool RefinesFocalLength(const Camera& camera,
                        const BundleAdjustmentOptions& options);

// Writes what the problem did not hold back to the reconstruction that it was
// built from.
void WriteBack(const BuiltProblem& built, Reconstruction* reconstruction);

// Holds what the residuals do not determine; see bundle_adjustment.h.
void FixGauge(const BundleState& state, BundleProblem* problem);

// The same, and scale even if residuals determine it.
void FixGaugeAndScale(const BundleState& state, BundleProblem* problem);

}  // namespace mgsfm
