// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/world_frame.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>
#include <vector>

#include "base/text.h"
#include "geometry/mean_direction.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

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

namespace {

constexpr char kPrefix[] = "known_baseline=";

[[noreturn]] void Throw(const std::string& text, const std::string& problem) {
  throw Error("metric_scale '" + text + "': " + problem);
}

std::vector<std::pair<int, int>> FindSensors(const Scene& scene,
                                             const std::string& name1,
                                             const std::string& name2) {
  std::vector<std::pair<int, int>> found;
  for (const Rig& rig : scene.rigs) {
    std::optional<int> sensor1, sensor2;
    for (const int sensor_idx : rig.sensor_idxs) {
      if (scene.sensors[sensor_idx].name == name1) sensor1 = sensor_idx;
      if (scene.sensors[sensor_idx].name == name2) sensor2 = sensor_idx;
    }
    if (sensor1 && sensor2 && *sensor1 != *sensor2) {
      found.emplace_back(*sensor1, *sensor2);
    }
  }
  return found;
}

std::string SensorNames(const Scene& scene) {
  std::string names;
  for (const Sensor& sensor : scene.sensors) {
    names += (names.empty() ? "'" : ", '") + sensor.name + "'";
  }
  return names;
}

void CheckKnownPoses(const std::string& text, const KnownBaseline& baseline,
                     const Scene& scene) {
  for (const auto& [sensor1, sensor2] : baseline.sensor_idxs) {
    const auto& pose1 = scene.sensors[sensor1].sensor_from_rig;
    const auto& pose2 = scene.sensors[sensor2].sensor_from_rig;
    if (!pose1 || !pose2) continue;
    const double known = (pose1->Center() - pose2->Center()).norm();
    // The error of a baseline of 0.3 m that was measured to 3 mm.
    if (std::abs(known - baseline.length_m) > 0.01 * baseline.length_m) {
      Throw(text, "the known rig has the distance " +
                      FormatDouble(known, std::chars_format::general, 6) +
                      "; correct one of them, or do not give the poses");
    }
  }
}

}  // namespace

std::optional<KnownBaseline> ParseMetricScale(const std::string& text,
                                              const Scene& scene) {
  if (text.empty()) return std::nullopt;
  const size_t begin = sizeof(kPrefix) - 1;
  const size_t second = text.rfind(':');
  const size_t first =
      second == std::string::npos ? second : text.rfind(':', second - 1);
  if (text.compare(0, begin, kPrefix) != 0 || first == std::string::npos ||
      first < begin || first == second) {
    Throw(text, "give known_baseline=CAMERA1:CAMERA2:METERS");
  }
  const auto length_m = ParseDouble(text.substr(second + 1));
  if (!length_m || !(*length_m > 0.0)) {
    Throw(text, "the last part is not a positive number of meters");
  }
  KnownBaseline baseline{
      FindSensors(scene, text.substr(begin, first - begin),
                  text.substr(first + 1, second - first - 1)),
      *length_m};
  if (baseline.sensor_idxs.empty()) {
    Throw(text,
          "no rig has both cameras; the cameras are " + SensorNames(scene));
  }
  CheckKnownPoses(text, baseline, scene);
  return baseline;
}

std::optional<double> MetersPerUnit(const KnownBaseline& baseline,
                                    const Reconstruction& model) {
  double sum = 0.0;
  int count = 0;
  for (const auto& [sensor1, sensor2] : baseline.sensor_idxs) {
    const auto& pose1 = model.sensor_from_rig[sensor1];
    const auto& pose2 = model.sensor_from_rig[sensor2];
    if (!pose1 || !pose2) continue;
    sum += (pose1->Center() - pose2->Center()).norm();
    ++count;
  }
  if (!(sum > 0.0)) return std::nullopt;
  return baseline.length_m * count / sum;
}

}  // namespace mgsfm
