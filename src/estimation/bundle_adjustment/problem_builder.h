// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The rig problem of bundle adjustment: keypoints and priors, no other terms.
using BundleProblem = RigProblem<PixelObservation>;
using BundleState = RigState;

// Numbers the used elements of an array densely, in the order of first use.
class DenseNumbering {
 public:
  explicit DenseNumbering(size_t size) : number_(size) {}

  // The number of element `idx`. `idxs` lists the numbered elements; a new one
  // is appended.
  int NumberOf(int idx, std::vector<int>* idxs) {
    if (!number_[idx]) {
      number_[idx] = static_cast<int>(idxs->size());
      idxs->push_back(idx);
    }
    return *number_[idx];
  }

 private:
  std::vector<std::optional<int>> number_;
};

// The bundle adjustment problem of a reconstruction, with the indices to write
// its solution back.
struct BuiltProblem {
  BundleProblem problem;
  BundleState state;
  // Indices in the scene, or in Reconstruction::points, of the elements of the
  // problem. Elements without observations are not in the problem.
  std::vector<int> image_idxs;
  std::vector<int> frame_idxs;
  std::vector<int> sensor_idxs;
  std::vector<int> camera_idxs;
  std::vector<int> point_idxs;
  size_t num_invisible_observations = 0;
};

enum class RefinedParts {
  kAll,
  kTranslations,  // rotations and intrinsics are constant
};

BuiltProblem BuildProblem(const Scene& scene,
                          const Reconstruction& reconstruction,
                          const BundleAdjustmentOptions& options,
                          RefinedParts parts, const BundlePriors& priors = {},
                          const FixedPoses& fixed = {});

// The refined coordinates of sensor_from_rig, and its prior if there is one.
// SensorPrior::sensor is the index in the scene.
struct RefinedSensor {
  PoseMask mask = PoseMask::Zero();
  std::optional<SensorPrior> prior;
};

RefinedSensor RefineSensor(const Scene& scene, int sensor_idx,
                           const BundleAdjustmentOptions& options);

// Whether the focal length of a camera of the scene is refined.
bool RefinesFocalLength(const Camera& camera,
                        const BundleAdjustmentOptions& options);

// Writes free parameters back to the reconstruction that the problem was built
// from.
void WriteBack(const BuiltProblem& built, Reconstruction* reconstruction);

// Fixes the gauge as described in bundle_adjustment.h.
void FixGauge(const BundleState& state, BundleProblem* problem);

// The same, but also fixes the scale if the residuals determine it.
void FixGaugeAndScale(const BundleState& state, BundleProblem* problem);

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
