// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "mgsfm/priors/prior_summaries.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/gravity_priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The direction of gravity in the world of a model: the robust mean of those
// measured in its images. nullopt if there are none.
std::optional<Eigen::Vector3d> GravityInWorld(const Scene& scene,
                                              const GravityPriors& gravity,
                                              const Reconstruction& model);

// What bundle adjustment is to use of it: with the standard deviation of the
// options, or what the model tells if that is more. nullopt if there is none.
struct GravityEstimate {
  Eigen::Vector3d down_in_world = Eigen::Vector3d::UnitY();
  double sigma_rad = 1.0;
};
std::optional<GravityEstimate> EstimateGravity(const Scene& scene,
                                               const GravityPriors& gravity,
                                               double sigma_deg,
                                               const Reconstruction& model);

// Turns a model that is not in the world of measured positions such that
// gravity is along +y, and says how well the measurements agree with it.
std::optional<GravitySummary> LevelModel(const Scene& scene,
                                         const GravityPriors& gravity,
                                         bool is_in_given_world,
                                         double sigma_deg,
                                         Reconstruction* model);

// How far measured gravity is from the +y of the world that given rotations of
// images have; those without one are left out.
[[nodiscard]] GravitySummary JudgeGravity(
    const GravityPriors& gravity,
    const std::vector<std::optional<Eigen::Quaterniond>>& cam_from_world,
    double sigma_deg);

}  // namespace mgsfm
