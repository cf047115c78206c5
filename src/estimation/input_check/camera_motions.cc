// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/camera_motions.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numeric>
#include <string>
#include <utility>

#include "base/format.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "rotation_averaging/hand_eye.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// Bounds the cost, which grows with the number of lags. With twice as many, a
// camera of another vehicle can pass for a lagging one
// (docs/results/constants.md).
constexpr int kMaxLag = 5;
// Frames of a motion: the smallest gap with several cycles of three frames.
// With 2, a lag in EuRoC is missed (docs/results/constants.md).
constexpr int kMaxGap = 3;
// Bounds the cost; the largest motions are the most informative.
constexpr size_t kMaxNumMotions = 400;
// Four times the three unknowns of a rotation.
constexpr int kMinNumMotions = 12;
// On correct drives, the best lag is 0, so the ratio is 1; a lag of one frame
// raises the error 2.9 times or more (docs/results/constants.md).
constexpr double kMinErrorRatio = 1.5;
// Errors of correct cameras reach 0.44 of the motion, at 2.1 standard
// deviations; errors of a foreign camera are at least 0.79, at 65
// (docs/results/input_check.md).
constexpr double kMaxForeignShare = 0.5;

// A motion of one sensor between two frames.
struct Motion {
  Vector3d rotation;                  // angle-axis
  std::optional<Vector3d> direction;  // of the translation
};
// Keys are the ranks of both frames.
using Motions = std::map<std::pair<int, int>, Motion>;

std::vector<Motions> CollectMotions(const Scene& scene,
                                    const ViewGraph& view_graph) {
  const std::vector<int> rank = RankFrames(scene);
  std::vector<Motions> motions(scene.sensors.size());
  for (const ImagePair& pair : view_graph.pairs) {
    const Image& image1 = scene.images[pair.image_idx1];
    const Image& image2 = scene.images[pair.image_idx2];
    if (!pair.relative_pose || image1.sensor_idx != image2.sensor_idx) continue;
    const int rank1 = rank[image1.frame_idx];
    const int rank2 = rank[image2.frame_idx];
    if (std::abs(rank1 - rank2) > kMaxGap) continue;
    const RelativePose& pose = *pair.relative_pose;
    Motion motion{LogSO3(pose.cam2_from_cam1), pose.translation_direction};
    if (rank1 > rank2) {
      if (motion.direction) {
        motion.direction =
            -(pose.cam2_from_cam1.conjugate() * *motion.direction);
      }
      motion.rotation = -motion.rotation;
    }
    motions[image1.sensor_idx][std::minmax(rank1, rank2)] = motion;
  }
  return motions;
}

// Motions that agree with others, and their noise.
struct CheckedMotions {
  Motions motions;
  double noise_rad = 0.0;  // standard deviation of the rotations per axis
};

// Keeps the motions that close a cycle of three frames, which removes most
// wrong pairs.
CheckedMotions CheckCycles(const Motions& motions) {
  std::vector<double> errors;
  std::map<std::pair<int, int>, double> least_error;
  for (const auto& [frames, motion] : motions) {
    const auto& [f, g] = frames;
    for (int h = g + 1; h <= f + kMaxGap; ++h) {
      const auto second = motions.find({g, h});
      const auto both = motions.find({f, h});
      if (second == motions.end() || both == motions.end()) continue;
      errors.push_back(AngleBetween(
          ExpSO3(second->second.rotation) * ExpSO3(motion.rotation),
          ExpSO3(both->second.rotation)));
      for (const auto& key : {frames, second->first, both->first}) {
        double& least = least_error.emplace(key, errors.back()).first->second;
        least = std::min(least, errors.back());
      }
    }
  }
  CheckedMotions checked;
  if (errors.empty()) return checked;
  const double sigma_of_cycles = RobustSigma<3>(std::move(errors));
  checked.noise_rad = sigma_of_cycles / std::sqrt(3.0);
  for (const auto& [key, error] : least_error) {
    if (error > kRareErrorInSigmas * sigma_of_cycles) continue;
    checked.motions[key] = motions.at(key);
  }
  return checked;
}

// The keys of the largest motions.
std::vector<std::pair<int, int>> SelectMotions(const Motions& motions) {
  std::vector<std::pair<double, std::pair<int, int>>> order;
  for (const auto& [frames, motion] : motions) {
    order.emplace_back(-motion.rotation.norm(), frames);
  }
  std::sort(order.begin(), order.end());
  order.resize(std::min(order.size(), kMaxNumMotions));
  return Transformed(order, [](const auto& entry) { return entry.second; });
}

// The mean without the largest tenth: motions across an impact on the rig do
// not indicate a foreign camera.
double TrimmedMean(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  values.resize(values.size() - values.size() / 10);
  return std::accumulate(values.begin(), values.end(), 0.0) /
         static_cast<double>(values.size());
}

struct LagFit {
  HandEyeResult rotation;                        // b_from_a
  std::map<std::pair<int, int>, double> errors;  // by the motion of a
  double mean_error = 0.0;
};

std::optional<LagFit> FitLag(const Motions& a, const Motions& b,
                             const std::vector<std::pair<int, int>>& keys,
                             int lag) {
  std::vector<MotionPair> pairs;
  std::vector<std::pair<int, int>> used;
  for (const auto& key : keys) {
    const auto found = b.find({key.first + lag, key.second + lag});
    if (found == b.end()) continue;
    pairs.push_back({found->second.rotation, a.at(key).rotation});
    used.push_back(key);
  }
  if (pairs.size() < kMinNumMotions) return std::nullopt;
  const HandEyeResult fit =
      CalibrateHandEye(pairs, static_cast<int>(pairs.size()));
  LagFit result{fit, {}, 0.0};
  std::vector<double> errors;
  for (size_t i = 0; i < pairs.size(); ++i) {
    errors.push_back(
        std::min((pairs[i].alpha - fit.a_from_b * pairs[i].beta).norm(),
                 kSameRotationRad));
    result.errors[used[i]] = errors.back();
  }
  result.mean_error = TrimmedMean(std::move(errors));
  return result;
}

std::vector<double> AxisErrors(const LagFit& fit, const Motions& a,
                               const Motions& b, const Quaterniond& b_from_a) {
  return Transformed(fit.errors, [&](const auto& error) {
    return AngleBetween(b.at(error.first).rotation,
                        b_from_a * a.at(error.first).rotation);
  });
}

double ShareBetter(const LagFit& fit, const LagFit& reference) {
  int num_common = 0, num_better = 0;
  for (const auto& [key, error] : fit.errors) {
    const auto found = reference.errors.find(key);
    if (found == reference.errors.end()) continue;
    ++num_common;
    num_better += error < found->second;
  }
  return num_common > 0 ? static_cast<double>(num_better) / num_common : 0.0;
}

// Whether upright cameras turn about the vertical axis in opposite directions.
bool TurnsOpposite(const LagFit& fit, const Motions& a) {
  Vector3d axis_a = Vector3d::Zero(), axis_b = Vector3d::Zero();
  double sum = 0.0;
  for (const auto& [key, error] : fit.errors) {
    Vector3d w = a.at(key).rotation;
    if (w.y() < 0.0) w = -w;
    axis_a += w;
    axis_b += fit.rotation.a_from_b * w;
    sum += w.norm();
  }
  const double most = std::cos(kSameDirectionRad) * sum;
  return axis_a.y() > most && axis_b.y() < -most;
}

bool IsCertain(const LagFit& fit) {
  return fit.rotation.uncertainty_rad <= kSameRotationRad;
}

// Whether the translations oppose those that the rotations imply.
bool MovesOpposite(const LagFit& fit, const Motions& a, const Motions& b,
                   int lag) {
  if (!IsCertain(fit)) return false;
  std::vector<double> cosines;
  for (const auto& [key, error] : fit.errors) {
    const auto& direction_a = a.at(key).direction;
    const auto& direction_b =
        b.at({key.first + lag, key.second + lag}).direction;
    if (!direction_a || !direction_b) continue;
    cosines.push_back(direction_b->dot(fit.rotation.a_from_b * *direction_a));
  }
  return !cosines.empty() &&
         Median(std::move(cosines)) < -std::cos(kSameDirectionRad);
}

std::optional<MotionAgreement> Compare(
    const Scene& scene, const std::vector<CheckedMotions>& motions,
    int sensor_a, int sensor_b) {
  const Motions& a = motions[sensor_a].motions;
  const Motions& b = motions[sensor_b].motions;
  const auto keys = SelectMotions(a);
  const auto zero = FitLag(a, b, keys, 0);
  if (!zero) return std::nullopt;
  MotionAgreement result;
  result.sensor_a = sensor_a;
  result.sensor_b = sensor_b;
  result.num_motions = static_cast<int>(zero->errors.size());
  for (const auto& [key, error] : zero->errors) {
    result.mean_motion_rad += a.at(key).rotation.norm() / result.num_motions;
  }
  result.noise_rad =
      std::hypot(motions[sensor_a].noise_rad, motions[sensor_b].noise_rad);
  result.error_rad = result.best_error_rad = zero->mean_error;
  result.is_mirrored = TurnsOpposite(*zero, a) || MovesOpposite(*zero, a, b, 0);
  if (IsCertain(*zero)) result.b_from_a = zero->rotation.a_from_b;
  const auto& known_a = scene.sensors[sensor_a].sensor_from_rig;
  const auto& known_b = scene.sensors[sensor_b].sensor_from_rig;
  if (known_a && known_b) {
    result.axis_to_known_rad = AxisErrors(
        *zero, a, b, known_b->rotation * known_a->rotation.conjugate());
    result.axis_to_fitted_rad =
        AxisErrors(*zero, a, b, zero->rotation.a_from_b);
  }
  for (int lag = -kMaxLag; lag <= kMaxLag; ++lag) {
    if (lag == 0) continue;
    const auto fit = FitLag(a, b, keys, lag);
    if (!fit || fit->mean_error >= result.best_error_rad) continue;
    result.best_lag = lag;
    result.best_error_rad = fit->mean_error;
    result.share_better = ShareBetter(*fit, *zero);
  }
  return result;
}

bool IsLagging(const MotionAgreement& m) {
  // Without a lag, each motion fits better at either lag with equal
  // probability.
  const double share_in_sigmas =
      2.0 * (m.share_better - 0.5) * std::sqrt(m.num_motions);
  return m.best_lag != 0 && share_in_sigmas > kRareErrorInSigmas &&
         m.error_rad > kMinErrorRatio * m.best_error_rad;
}

// Whether noise alone explains an angle of this size.
bool IsNoise(double angle_rad, const MotionAgreement& m) {
  return angle_rad <= kRareErrorInSigmas * m.noise_rad;
}

bool IsForeign(const MotionAgreement& m) {
  return m.best_error_rad > kMaxForeignShare * m.mean_motion_rad &&
         !IsNoise(m.best_error_rad, m);
}

// b_from_a, if the pairs between the two cameras agree on a rotation.
std::optional<Quaterniond> RotationByPairs(
    const std::vector<SensorPairSamples>& samples, int sensor_a, int sensor_b) {
  for (const SensorPairSamples& pair : samples) {
    if (pair.sensor_a != std::min(sensor_a, sensor_b) ||
        pair.sensor_b != std::max(sensor_a, sensor_b)) {
      continue;
    }
    const auto typical = FindTypicalPose(pair.samples);
    if (!typical || typical->median_deviation_rad >= kSameRotationRad) break;
    return sensor_a < sensor_b ? typical->b_from_a
                               : typical->b_from_a.conjugate();
  }
  return std::nullopt;
}

// Whether the motions are those of mirrored images and contradict the rotation
// on which the pairs agree. If the images of b are mirrored, S = M R, where R
// is the rotation of b relative to a, and M turns by 180 degrees about the
// horizontal axis. If the images of a are mirrored, S = R M. A camera that lags
// under vibration may have such an S, too, but its errors exceed noise.
bool IsMirrorOfPairs(const MotionAgreement& m, const Quaterniond& by_pairs) {
  const Quaterniond mirror(0.0, 1.0, 0.0, 0.0);
  constexpr double kHalfwayRad = kPi / 2;  // between equal and opposite
  return m.b_from_a && IsNoise(m.error_rad, m) &&
         AngleBetween(*m.b_from_a, mirror) < kHalfwayRad &&
         AngleBetween(*m.b_from_a, by_pairs) > kHalfwayRad;
}

// Whether a model explains most matches of both cameras.
bool AreExplained(const MotionAgreement& m, const KeptMatches* kept) {
  return kept != nullptr && kept->sensors[m.sensor_a].IsMostlyKept() &&
         kept->sensors[m.sensor_b].IsMostlyKept();
}

bool IsMirrored(const MotionAgreement& m,
                const std::vector<SensorPairSamples>& samples,
                const KeptMatches* kept) {
  if (IsNoise(m.mean_motion_rad, m)) return false;
  const auto by_pairs = RotationByPairs(samples, m.sensor_a, m.sensor_b);
  return by_pairs ? IsMirrorOfPairs(m, *by_pairs)
                  : m.is_mirrored && !AreExplained(m, kept);
}

std::vector<std::pair<std::string, double>> EvidenceOf(
    const MotionAgreement& m) {
  return {{"num_motions", m.num_motions},
          {"mean_motion_deg", RadToDeg(m.mean_motion_rad)},
          {"noise_deg", RadToDeg(m.noise_rad)},
          {"error_deg", RadToDeg(m.error_rad)},
          {"best_lag_frames", m.best_lag},
          {"error_at_best_lag_deg", RadToDeg(m.best_error_rad)}};
}

Finding DescribeLag(const std::string& a, const std::string& b,
                    const MotionAgreement& m) {
  const int num_frames = std::abs(m.best_lag);
  const std::string late = m.best_lag > 0 ? b : a;
  const std::string other = m.best_lag > 0 ? a : b;
  return {Cause::kCameraLag,
          {late, other},
          {},
          EvidenceOf(m),
          "camera '" + late + "' is " + std::to_string(num_frames) +
              (num_frames == 1 ? " frame" : " frames") + " behind camera '" +
              other + "'",
          "rename its images so that simultaneous images share a frame"};
}

Finding DescribeForeign(const std::string& a, const std::string& b,
                        const MotionAgreement& m) {
  return {Cause::kForeignCamera,
          {b, a},
          {},
          EvidenceOf(m),
          "camera '" + b + "' does not move with camera '" + a +
              "': their rotations between frames differ by " +
              Formatted("%.0f", 100.0 * m.best_error_rad / m.mean_motion_rad) +
              " %",
          "remove its images, or correct the assignment of images to frames"};
}

Finding DescribeMirrored(const std::string& a, const std::string& b,
                         const MotionAgreement& m) {
  return {Cause::kMirroredCamera,
          {b, a},
          {},
          EvidenceOf(m),
          "cameras '" + b + "' and '" + a +
              "' move like mirror images of each other, and their matches "
              "confirm no rotation between them: the images of one of them are "
              "mirrored or upside down",
          "flip the images of that camera and extract their features again"};
}

}  // namespace

std::vector<MotionAgreement> CompareMotions(const Scene& scene,
                                            const ViewGraph& view_graph) {
  const std::vector<CheckedMotions> motions =
      Transformed(CollectMotions(scene, view_graph), CheckCycles);
  std::vector<MotionAgreement> result;
  for (const Rig& rig : scene.rigs) {
    int reference = rig.ref_sensor_idx;
    for (const int k : rig.sensor_idxs) {
      if (motions[k].motions.size() > motions[reference].motions.size()) {
        reference = k;
      }
    }
    for (const int k : rig.sensor_idxs) {
      if (k == reference) continue;
      if (const auto m = Compare(scene, motions, reference, k))
        result.push_back(*m);
    }
  }
  return result;
}

std::vector<Finding> CheckMotions(const Scene& scene,
                                  const ViewGraph& view_graph,
                                  const std::vector<SensorPairSamples>& samples,
                                  const KeptMatches* kept) {
  std::vector<Finding> findings;
  for (const MotionAgreement& m : CompareMotions(scene, view_graph)) {
    const std::string& a = scene.sensors[m.sensor_a].name;
    const std::string& b = scene.sensors[m.sensor_b].name;
    if (IsLagging(m)) {
      findings.push_back(DescribeLag(a, b, m));
    } else if (IsForeign(m)) {
      findings.push_back(DescribeForeign(a, b, m));
    } else if (IsMirrored(m, samples, kept)) {
      findings.push_back(DescribeMirrored(a, b, m));
    }
  }
  return findings;
}

}  // namespace mgsfm
