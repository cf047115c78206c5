// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/epipolar.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// The truncated squared Sampson errors without the cheirality test. Stops above
// `max_cost`. |E| = sqrt 2.
double ScoreEssential(const RayMatches& matches, const Eigen::Matrix3d& E,
                      double max_error, double max_cost) {
  const double max_squared_error = max_error * max_error;
  double cost = 0.0;
  for (size_t i = 0; i < matches.size() && cost <= max_cost; ++i) {
    const Eigen::Vector3d normal2 = E * matches.rays1[i];
    const Eigen::Vector3d normal1 = E.transpose() * matches.rays2[i];
    const double e = matches.rays2[i].dot(normal2);
    const double s =
        normal1.squaredNorm() + normal2.squaredNorm() - 2.0 * e * e;
    cost += e * e <= max_squared_error * s ? e * e / std::max(s, 1e-14)
                                           : max_squared_error;
  }
  return cost;
}

template <class Model>
struct Scored {
  Model model;
  PoseScore score{std::numeric_limits<double>::infinity(), 0};
};

PoseRefinementOptions LocalOptions(const RansacOptions& options) {
  PoseRefinementOptions local;
  local.loss_scale_rad = 0.5 * options.max_error_rad;
  // Local refinements rank hypotheses; the best one is refined to convergence.
  // More steps only cost time.
  local.max_num_iterations = 5;
  local.relative_cost_tolerance = 1e-3;
  return local;
}

// Keeps the refined model if its score improves.
void OptimizeLocally(const RayMatches& matches, const RansacOptions& options,
                     Scored<Rigid3>* best) {
  RayMatches inliers;
  inliers.Reserve(best->score.num_inliers);
  const Mask is_inlier =
      FindInliers(matches, best->model, options.max_error_rad);
  for (size_t i = 0; i < matches.size(); ++i) {
    if (is_inlier[i]) inliers.Add(matches.rays1[i], matches.rays2[i]);
  }
  Rigid3 refined = best->model;
  if (!RefineRelativePose(inliers, LocalOptions(options), &refined)
           .IsUsable()) {
    return;
  }
  const PoseScore score =
      ScoreRelativePose(matches, refined, options.max_error_rad);
  if (score.cost < best->score.cost) *best = {refined, score};
}

void OptimizeLocally(const RayMatches& matches, const RansacOptions& options,
                     Scored<Eigen::Quaterniond>* best) {
  Eigen::Quaterniond refined = best->model;
  if (!RefineRotation(matches, LocalOptions(options), &refined).IsUsable()) {
    return;
  }
  const PoseScore score =
      ScoreRotation(matches, refined, options.max_error_rad);
  if (score.cost < best->score.cost) *best = {refined, score};
}

// The best pose of the sample, if it is better than `best`.
std::optional<Scored<Rigid3>> BestOfPoseSample(const RayMatches& matches,
                                               const RansacOptions& options,
                                               double best_cost,
                                               Random* random) {
  const auto sample = DrawSample<5>(matches.size(), random);
  std::array<Eigen::Vector3d, 5> rays1, rays2;
  for (size_t i = 0; i < 5; ++i) {
    rays1[i] = matches.rays1[sample[i]];
    rays2[i] = matches.rays2[sample[i]];
  }
  std::array<Eigen::Matrix3d, 10> essentials;
  const int num_essentials = SolveFivePoint(rays1, rays2, &essentials);
  std::optional<Scored<Rigid3>> best;
  for (int i = 0; i < num_essentials; ++i) {
    // The cheirality test can only increase the cost.
    if (ScoreEssential(matches, essentials[i], options.max_error_rad,
                       best_cost) >= best_cost) {
      continue;
    }
    for (const Rigid3& pose : DecomposeEssential(essentials[i])) {
      const PoseScore score =
          ScoreRelativePose(matches, pose, options.max_error_rad);
      if (score.cost < best_cost) {
        best_cost = score.cost;
        best = {pose, score};
      }
    }
  }
  return best;
}

// The rotation that maps the bisector and the plane of two rays to the bisector
// and the plane of the matching rays.
std::optional<Scored<Eigen::Quaterniond>> BestOfRotationSample(
    const RayMatches& matches, const RansacOptions& options, double best_cost,
    Random* random) {
  const auto sample = DrawSample<2>(matches.size(), random);
  const auto axes = [&](const std::vector<Eigen::Vector3d>& rays) {
    Eigen::Matrix3d m;
    m.col(0) = (rays[sample[0]] + rays[sample[1]]).normalized();
    m.col(1) = (rays[sample[0]] - rays[sample[1]]).normalized();
    m.col(2) = m.col(0).cross(m.col(1));
    return m;
  };
  const Eigen::Quaterniond rotation(
      Eigen::Matrix3d(axes(matches.rays2) * axes(matches.rays1).transpose()));
  // The axes are undefined for equal or opposite rays.
  if (!(std::abs(rotation.norm() - 1.0) < 1e-6)) return std::nullopt;
  const Scored<Eigen::Quaterniond> scored{
      rotation.normalized(),
      ScoreRotation(matches, rotation, options.max_error_rad)};
  if (!(scored.score.cost < best_cost)) return std::nullopt;
  return scored;
}

template <int kSampleSize, class Model, class BestOfSample>
std::optional<Model> RunRansac(const RayMatches& matches,
                               const RansacOptions& options, Random* random,
                               const BestOfSample& best_of_sample) {
  if (matches.size() < kSampleSize) return std::nullopt;
  Scored<Model> best;
  int num_trials = options.max_num_trials;
  for (int trial = 0; trial < num_trials; ++trial) {
    std::optional<Scored<Model>> scored =
        best_of_sample(matches, options, best.score.cost, random);
    if (!scored) continue;
    OptimizeLocally(matches, options, &*scored);
    best = *scored;
    const double inlier_ratio =
        static_cast<double>(best.score.num_inliers) / matches.size();
    num_trials = RequiredNumTrials(options, inlier_ratio, kSampleSize);
  }
  if (best.score.num_inliers < kSampleSize) return std::nullopt;
  return best.model;
}

}  // namespace

std::optional<Rigid3> EstimateRelativePose(const RayMatches& matches,
                                           const RansacOptions& options,
                                           Random* random) {
  return RunRansac<5, Rigid3>(matches, options, random, BestOfPoseSample);
}

std::optional<Eigen::Quaterniond> EstimateRotation(const RayMatches& matches,
                                                   const RansacOptions& options,
                                                   Random* random) {
  return RunRansac<2, Eigen::Quaterniond>(matches, options, random,
                                          BestOfRotationSample);
}

}  // namespace mgsfm
