// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/gravity_leveling.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "geometry/mean_direction.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// Angles to a direction are norms of vectors with two coordinates.
double SigmaOfAngles(double prior_sigma, std::vector<double> angles) {
  return std::max(prior_sigma, RobustSigma<2>(std::move(angles)));
}

// The errors of measured gravity if `down` is the direction of gravity in the
// world.
GravitySummary EvaluateInWorld(const Scene& scene, const GravityPriors& gravity,
                               const Vector3d& down, double sigma_deg,
                               const Reconstruction& model) {
  const Quaterniond world_from_level = RotationBetween(Vector3d::UnitY(), down);
  std::vector<std::optional<Quaterniond>> cam_from_level(scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto pose = model.CamFromWorld(scene, static_cast<int>(i));
    if (pose) cam_from_level[i] = pose->rotation * world_from_level;
  }
  return EvaluateGravity(gravity, cam_from_level, sigma_deg);
}

}  // namespace

std::optional<Vector3d> GravityInWorld(const Scene& scene,
                                       const GravityPriors& gravity,
                                       const Reconstruction& model) {
  std::vector<Vector3d> directions;
  for (size_t i = 0; i < gravity.images.size(); ++i) {
    const auto pose = model.CamFromWorld(scene, static_cast<int>(i));
    if (!pose || !gravity.images[i]) continue;
    directions.push_back(pose->rotation.conjugate() * *gravity.images[i]);
  }
  if (directions.empty()) return std::nullopt;
  return RobustMeanDirection(directions);
}

std::optional<GravityEstimate> EstimateGravity(const Scene& scene,
                                               const GravityPriors& gravity,
                                               double sigma_deg,
                                               const Reconstruction& model) {
  const std::optional<Vector3d> down = GravityInWorld(scene, gravity, model);
  if (!down) return std::nullopt;
  const GravitySummary summary =
      EvaluateInWorld(scene, gravity, *down, sigma_deg, model);
  return GravityEstimate{*down, DegToRad(summary.sigma_deg)};
}

std::optional<GravitySummary> LevelModel(const Scene& scene,
                                         const GravityPriors& gravity,
                                         bool world_is_fixed, double sigma_deg,
                                         Reconstruction* model) {
  const std::optional<Vector3d> down = GravityInWorld(scene, gravity, *model);
  if (!down) return std::nullopt;
  const GravitySummary summary =
      EvaluateInWorld(scene, gravity, *down, sigma_deg, *model);
  if (!world_is_fixed) {
    const Quaterniond level_from_world =
        RotationBetween(*down, Vector3d::UnitY());
    TransformWorld({1.0, level_from_world, Vector3d::Zero()}, model);
  }
  return summary;
}

GravitySummary EvaluateGravity(
    const GravityPriors& gravity,
    const std::vector<std::optional<Quaterniond>>& cam_from_world,
    double sigma_deg) {
  GravitySummary summary;
  std::vector<double> errors_deg;
  std::vector<int> image_idxs;
  for (size_t i = 0; i < gravity.images.size(); ++i) {
    if (!gravity.images[i] || !cam_from_world[i]) continue;
    errors_deg.push_back(RadToDeg(
        AngleBetween(cam_from_world[i]->conjugate() * *gravity.images[i],
                     Vector3d::UnitY().eval())));
    image_idxs.push_back(static_cast<int>(i));
  }
  summary.num_priors = static_cast<int>(errors_deg.size());
  summary.sigma_deg = sigma_deg;
  if (errors_deg.empty()) return summary;
  summary.median_error_deg = Median(errors_deg);
  summary.sigma_deg = SigmaOfAngles(sigma_deg, errors_deg);
  // Normal errors of a direction exceed 4 sigma with probability exp(-8) =
  // 3e-4.
  const double bound = 4.0 * summary.sigma_deg;
  for (size_t i = 0; i < errors_deg.size(); ++i) {
    if (errors_deg[i] <= bound) continue;
    summary.outliers.push_back({image_idxs[i], errors_deg[i]});
  }
  return summary;
}

}  // namespace mgsfm
