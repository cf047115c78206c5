// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The direction of gravity in the world of a model: the robust mean of the
// directions measured in its images. nullopt without measurements.
std::optional<Eigen::Vector3d> GravityInWorld(const Scene& scene,
                                              const GravityPriors& gravity,
                                              const Reconstruction& model);

// GravityInWorld with the standard deviation of the measurements: sigma_deg, or
// the robust estimate from the model if larger.
struct GravityEstimate {
  Eigen::Vector3d down_in_world = Eigen::Vector3d::UnitY();
  double sigma_rad = 1.0;
};
std::optional<GravityEstimate> EstimateGravity(const Scene& scene,
                                               const GravityPriors& gravity,
                                               double sigma_deg,
                                               const Reconstruction& model);

// Rotates a model such that gravity is along +y, unless its world is fixed, and
// summarizes the agreement of the measurements. nullopt without measurements.
std::optional<GravitySummary> LevelModel(const Scene& scene,
                                         const GravityPriors& gravity,
                                         bool world_is_fixed, double sigma_deg,
                                         Reconstruction* model);

// The angles between measured gravity and +y in the world of these rotations.
// Images without a rotation are ignored.
[[nodiscard]] GravitySummary EvaluateGravity(
    const GravityPriors& gravity,
    const std::vector<std::optional<Eigen::Quaterniond>>& cam_from_world,
    double sigma_deg);

// The measured distance of the centers of two sensors.
struct KnownBaseline {
  std::vector<std::pair<int, int>> sensor_idxs;  // one pair per rig
  double length_m = 0.0;
};

// Parses "known_baseline=LEFT:RIGHT:METERS" with names of sensors; nullopt if
// the text is empty. Throws Error unless the length is positive and a rig has
// both sensors.
std::optional<KnownBaseline> ParseMetricScale(const std::string& text,
                                              const Scene& scene);

// The factor that makes the mean distance of the estimated sensor pairs equal
// to the known distance; nullopt if none is estimated or all coincide.
std::optional<double> MetersPerUnit(const KnownBaseline& baseline,
                                    const Reconstruction& model);

}  // namespace mgsfm
