// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/gravity_priors.h"
#include "mgsfm/scene/position_priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The direction of gravity in the world of a model: the robust mean of those
// measured in its images. nullopt if there are none.
std::optional<Eigen::Vector3d> GravityInWorld(const Scene& scene,
                                              const GravityPriors& gravity,
                                              const Reconstruction& model);

// What bundle adjustment is to use of it: with the standard deviation of the
// options, or what the model tells if that is more. nullopt if there is none.
std::optional<MeasuredGravity> MakeGravityTerms(
    const Scene& scene, const GravityPriors& gravity,
    const RotationAveragingOptions& options, const Reconstruction& model);

// Turns a model that is not in the world of measured positions such that
// gravity is along +y, and says how well the measurements agree with it.
std::optional<GravitySummary> LevelModel(const Scene& scene,
                                         const GravityPriors& gravity,
                                         bool is_in_given_world,
                                         double sigma_deg,
                                         Reconstruction* model);

}  // namespace mgsfm
