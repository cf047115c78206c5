// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/gravity_levelling.h"

#include <algorithm>
#include <vector>

#include "mgsfm/geometry/mean_direction.h"
#include "mgsfm/geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// How far gravity is from `down` in a world.
GravitySummary Judge(const Scene& scene, const GravityPriors& gravity,
                     const Vector3d& down, double sigma_deg,
                     const Reconstruction& model) {
  const auto world_from_level =
      Quaterniond::FromTwoVectors(Vector3d::UnitY(), down);
  std::vector<std::optional<Quaterniond>> cam_from_level(scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto pose = model.CamFromWorld(scene, static_cast<int>(i));
    if (pose) cam_from_level[i] = pose->rotation * world_from_level;
  }
  return JudgeGravity(gravity, cam_from_level, sigma_deg);
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

std::optional<MeasuredGravity> MakeGravityTerms(
    const Scene& scene, const GravityPriors& gravity,
    const RotationAveragingOptions& options, const Reconstruction& model) {
  const std::optional<Vector3d> down = GravityInWorld(scene, gravity, model);
  if (!down) return std::nullopt;
  const GravitySummary summary =
      Judge(scene, gravity, *down, options.gravity_sigma_deg, model);
  return MeasuredGravity{gravity.images, *down, DegToRad(summary.sigma_deg)};
}

std::optional<GravitySummary> LevelModel(const Scene& scene,
                                         const GravityPriors& gravity,
                                         bool is_in_given_world,
                                         double sigma_deg,
                                         Reconstruction* model) {
  const std::optional<Vector3d> down = GravityInWorld(scene, gravity, *model);
  if (!down) return std::nullopt;
  const GravitySummary summary =
      Judge(scene, gravity, *down, sigma_deg, *model);
  if (!is_in_given_world) {
    const auto level_from_world =
        Quaterniond::FromTwoVectors(*down, Vector3d::UnitY());
    TransformWorld({1.0, level_from_world, Vector3d::Zero()}, model);
  }
  return summary;
}

}  // namespace mgsfm
