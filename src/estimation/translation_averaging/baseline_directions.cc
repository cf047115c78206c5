// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/baseline_directions.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "base/parallel.h"
#include "base/random.h"
#include "geometry/decompositions.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// docs/results/constants.md shows the sensitivity to these thresholds.
//
// Assumed error of the rotations. This error displaces all rays of an image
// alike, so more matches do not average it out.
constexpr double kRotationSigma = DegToRad(0.05);
// Less certain directions are reported as unknown, because the small-angle
// model of sigma_rad does not hold for them.
constexpr double kMaxDirectionSigma = DegToRad(15.0);
// Four times the two degrees of freedom of a direction.
constexpr int kMinNumParallax = 8;
// 30 samples draw two inliers together with probability 1 - 1e-4 if 51 % of the
// matches are inliers: log(1e-4) / log(1 - 0.514^2) = 30.
constexpr int kMaxNumHypotheses = 30;
constexpr double kLogFailureProbability = -9.2;  // log(1e-4)

// The matches of a pair in the layout that the estimation reads.
struct BaselineMatches {
  const std::vector<Vector3d>& rays1;  // in world axes
  const std::vector<Vector3d>& rays2;
  std::vector<Vector3d> normals;  // ray1 x ray2
  std::vector<size_t> wide;       // matches with parallax
  double max_residual_rad = 0.0;  // upper bound of the residual of an inlier
  double min_sine = 0.0;          // lower bound of |normal| with parallax

  bool HasParallax(size_t m) const { return normals[m].norm() > min_sine; }
  // |b x g1|^2 + |b x g2|^2 for unit vectors.
  double SampsonNorm2(const Vector3d& b, size_t m) const {
    const double c1 = b.dot(rays1[m]);
    const double c2 = b.dot(rays2[m]);
    // Lower bound of |b x g1|^2 + |b x g2|^2, i.e. rays within 0.4 degrees of
    // the epipoles of both cameras; keeps the residual finite there.
    return std::max(2.0 - c1 * c1 - c2 * c2, 1e-4);
  }
  double SquaredResidual(const Vector3d& b, size_t m) const {
    const double e = b.dot(normals[m]);
    return e * e / SampsonNorm2(b, m);
  }
  double Residual(const Vector3d& b, size_t m) const {
    return b.dot(normals[m]) / std::sqrt(SampsonNorm2(b, m));
  }
  // Depths in baselines along both rays.
  Eigen::Vector2d SignedDepths(const Vector3d& b, size_t m) const {
    const Vector3d& n = normals[m];
    return Eigen::Vector2d(b.cross(rays2[m]).dot(n), b.cross(rays1[m]).dot(n)) /
           n.squaredNorm();
  }
};

// noise_rad is the standard deviation of a ray.
BaselineMatches PrepareMatches(const RayMatches& matches, double noise_rad,
                               double min_sine) {
  BaselineMatches prepared{matches.rays1,
                           matches.rays2,
                           {},
                           {},
                           2.0 * noise_rad + kRotationSigma,
                           std::max(min_sine, 3.0 * noise_rad)};
  for (size_t m = 0; m < matches.size(); ++m) {
    prepared.normals.push_back(matches.rays1[m].cross(matches.rays2[m]));
    if (prepared.HasParallax(m)) prepared.wide.push_back(m);
  }
  return prepared;
}

struct Hypothesis {
  Vector3d direction = Vector3d::Zero();
  double score = std::numeric_limits<double>::infinity();
  double inlier_ratio = 0.0;
};

// Replaces `best` if `direction`, of any length, has a lower score.
void TryHypothesis(const BaselineMatches& matches, const Vector3d& direction,
                   Hypothesis* best) {
  const double norm = direction.norm();
  if (!(norm > 1e-12)) return;
  const Vector3d b = direction / norm;
  const double max2 = matches.max_residual_rad * matches.max_residual_rad;
  double score = 0.0;
  int num_scored = 0, num_inliers = 0;
  // Matches without parallax agree with every direction; the others decide.
  const std::vector<size_t>& wide = matches.wide;
  for (size_t k = 0; k < wide.size();
       k += 1 + wide.size() / kSufficientNumSamples) {
    const double residual2 = matches.SquaredResidual(b, wide[k]);
    score += std::min(residual2, max2);
    ++num_scored;
    num_inliers += residual2 < max2;
  }
  const size_t size = matches.normals.size();
  const size_t stride = 1 + size / kSufficientNumSamples;
  for (size_t m = 0; m < size && score < best->score; m += stride) {
    score += std::min(matches.SquaredResidual(b, m), max2);
  }
  if (score < best->score) {
    *best = {b, score, static_cast<double>(num_inliers) / num_scored};
  }
}

// Number of samples after which two inliers have almost surely been drawn
// together.
int NumHypotheses(double inlier_ratio) {
  const double success = std::min(inlier_ratio * inlier_ratio, 0.99);
  if (success * kMaxNumHypotheses < -kLogFailureProbability) {
    return kMaxNumHypotheses;
  }
  return static_cast<int>(
      std::ceil(kLogFailureProbability / std::log1p(-success)));
}

Hypothesis SampleDirection(const BaselineMatches& matches,
                           const std::optional<Vector3d>& guess,
                           Random* random) {
  Hypothesis best;
  if (guess) TryHypothesis(matches, *guess, &best);
  const auto num_wide = static_cast<uint32_t>(matches.wide.size());
  for (int i = 0; i < NumHypotheses(best.inlier_ratio); ++i) {
    const Vector3d& n1 = matches.normals[matches.wide[random->Index(num_wide)]];
    const Vector3d& n2 = matches.normals[matches.wide[random->Index(num_wide)]];
    TryHypothesis(matches, n1.cross(n2), &best);
  }
  return best;
}

struct ResidualNoise {
  double sigma_rad = 0.0;
  double max_inlier_rad = 0.0;  // three standard deviations, bounded

  double GemanMcClure(double squared_residual) const {
    const double denominator =
        1.0 + squared_residual / (max_inlier_rad * max_inlier_rad);
    return 1.0 / (denominator * denominator);
  }
};

ResidualNoise EstimateNoise(const BaselineMatches& matches,
                            const Vector3d& direction,
                            std::vector<double>* scratch) {
  scratch->clear();
  const double max2 = matches.max_residual_rad * matches.max_residual_rad;
  for (size_t m = 0; m < matches.normals.size(); ++m) {
    const double residual2 = matches.SquaredResidual(direction, m);
    if (residual2 < max2) scratch->push_back(std::sqrt(residual2));
  }
  ResidualNoise noise;
  noise.sigma_rad =
      scratch->empty() ? matches.max_residual_rad : RobustSigma<1>(*scratch);
  noise.max_inlier_rad =
      std::clamp(3.0 * noise.sigma_rad, 1e-6, matches.max_residual_rad);
  return noise;
}

// The minimizer for weights at `direction`; nullopt if it is not finite.
std::optional<Vector3d> SolveReweighted(const BaselineMatches& matches,
                                        const Vector3d& direction,
                                        const ResidualNoise& noise) {
  Matrix3d M = Matrix3d::Zero();
  Matrix3d G = Matrix3d::Zero();
  double sum = 0.0;
  for (size_t m = 0; m < matches.normals.size(); ++m) {
    const double norm2 = matches.SampsonNorm2(direction, m);
    const double e = direction.dot(matches.normals[m]);
    const double weight = noise.GemanMcClure(e * e / norm2) / norm2;
    M.noalias() +=
        (weight * matches.normals[m]) * matches.normals[m].transpose();
    G.noalias() += (weight * matches.rays1[m]) * matches.rays1[m].transpose();
    G.noalias() += (weight * matches.rays2[m]) * matches.rays2[m].transpose();
    sum += weight;
  }
  Matrix3d N = 2.0 * sum * Matrix3d::Identity() - G;
  N += 1e-9 * N.trace() * Matrix3d::Identity();  // definite despite rounding
  const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix3d> eigen(M, N);
  Vector3d next = eigen.eigenvectors().col(0).normalized();
  if (!next.allFinite()) return std::nullopt;
  if (next.dot(direction) < 0.0) next = -next;
  return next;
}

struct RefinedDirection {
  Vector3d direction;
  ResidualNoise noise;
};

RefinedDirection RefineDirection(const BaselineMatches& matches,
                                 const Vector3d& start) {
  RefinedDirection refined{start, {}};
  std::vector<double> scratch;
  for (int i = 0; i < 20; ++i) {
    refined.noise = EstimateNoise(matches, refined.direction, &scratch);
    const auto next =
        SolveReweighted(matches, refined.direction, refined.noise);
    if (!next) break;
    const double step = (*next - refined.direction).norm();
    refined.direction = *next;
    // The step, in radians, is far below the error of any direction.
    if (step < 1e-6) break;
  }
  return refined;
}

// The direction or its opposite, whichever has more points in front of both
// cameras; nullopt if these are too few for a clear majority: 70 % of the
// agreeing matches and half of those with parallax.
std::optional<Vector3d> ChooseSign(const BaselineMatches& matches,
                                   const RefinedDirection& refined) {
  size_t num_agreeing = 0, num_positive = 0, num_negative = 0;
  for (const size_t m : matches.wide) {
    if (std::abs(matches.Residual(refined.direction, m)) >
        refined.noise.max_inlier_rad) {
      continue;
    }
    ++num_agreeing;
    const Eigen::Vector2d depths = matches.SignedDepths(refined.direction, m);
    num_positive += depths.minCoeff() > 0.0;
    num_negative += depths.maxCoeff() < 0.0;
  }
  const size_t num_good = std::max(num_positive, num_negative);
  if (num_good < kMinNumParallax || 10 * num_good < 7 * num_agreeing ||
      2 * num_good < matches.wide.size()) {
    return std::nullopt;
  }
  return num_negative > num_positive ? Vector3d(-refined.direction)
                                     : refined.direction;
}

// Standard deviation of the least certain component of the direction; nullopt
// if it is unbounded or too large.
std::optional<double> DirectionSigma(const BaselineMatches& matches,
                                     const Vector3d& direction,
                                     const ResidualNoise& noise) {
  Matrix3d information = Matrix3d::Zero();
  std::vector<double> sines;
  for (const size_t m : matches.wide) {
    const double residual2 = matches.SquaredResidual(direction, m);
    if (residual2 > noise.max_inlier_rad * noise.max_inlier_rad) continue;
    information += noise.GemanMcClure(residual2) /
                   matches.SampsonNorm2(direction, m) * matches.normals[m] *
                   matches.normals[m].transpose();
    sines.push_back(matches.normals[m].norm());
  }
  Eigen::Matrix<double, 3, 2> tangent;
  tangent.col(0) = direction.unitOrthogonal();
  tangent.col(1) = direction.cross(tangent.col(0));
  const SymmetricEigen<Eigen::Matrix2d> eigen(tangent.transpose() *
                                              information * tangent);
  const double least = eigen.values[0];
  if (!(least > 0.0)) return std::nullopt;
  const double sigma = std::hypot(noise.sigma_rad / std::sqrt(least),
                                  kRotationSigma / Median(std::move(sines)));
  if (!(sigma < kMaxDirectionSigma)) return std::nullopt;
  return sigma;
}

struct DirectionEstimate {
  Vector3d direction;
  double sigma_rad = 0.0;
  ResidualNoise noise;
};

std::optional<DirectionEstimate> EstimateDirection(
    const BaselineMatches& matches, const std::optional<Vector3d>& guess,
    Random* random) {
  if (matches.wide.size() < kMinNumParallax) return std::nullopt;
  const Hypothesis best = SampleDirection(matches, guess, random);
  if (!std::isfinite(best.score)) return std::nullopt;
  const RefinedDirection refined = RefineDirection(matches, best.direction);
  const auto direction = ChooseSign(matches, refined);
  if (!direction) return std::nullopt;
  const auto sigma_rad = DirectionSigma(matches, *direction, refined.noise);
  if (!sigma_rad) return std::nullopt;
  return DirectionEstimate{*direction, *sigma_rad, refined.noise};
}

// Depths in baselines along both rays; nullopt unless the match has parallax,
// agrees with the direction and is in front of both cameras.
std::optional<Eigen::Vector2d> DepthsOf(const BaselineMatches& matches,
                                        const DirectionEstimate& estimate,
                                        size_t m) {
  if (!matches.HasParallax(m)) return std::nullopt;
  if (std::abs(matches.Residual(estimate.direction, m)) >
      estimate.noise.max_inlier_rad) {
    return std::nullopt;
  }
  const Eigen::Vector2d depths = matches.SignedDepths(estimate.direction, m);
  if (depths.minCoeff() <= 0.0) return std::nullopt;
  return depths;
}

void CollectDepths(const BaselineMatches& matches,
                   const DirectionEstimate& estimate,
                   const std::vector<Match>& used,
                   BaselineDirection* baseline) {
  for (size_t m = 0; m < used.size(); ++m) {
    const auto depths = DepthsOf(matches, estimate, m);
    if (!depths) continue;
    baseline->depths[0].push_back({static_cast<int>(used[m].keypoint_idx1),
                                   static_cast<float>(std::log((*depths)[0]))});
    baseline->depths[1].push_back({static_cast<int>(used[m].keypoint_idx2),
                                   static_cast<float>(std::log((*depths)[1]))});
  }
  for (auto& depths : baseline->depths) SortByKeypoint(&depths);
}

// The angle of one pixel in the camera of an image.
double PixelRad(const Scene& scene, int image_idx) {
  return 1.0 /
         PixelsPerRadian(scene.cameras[scene.images[image_idx].camera_idx]);
}

struct PairRays {
  RayMatches rays;          // in world axes
  std::vector<Match> used;  // the matches with two rays
};

PairRays CollectRays(const Bearings& bearings, const PositionProblem& problem,
                     const ImagePair& pair, PairRotation rotation) {
  PairRays collected;
  const Matrix3d& world_from_cam2 = *problem.world_from_cam[pair.image_idx2];
  const Matrix3d world_from_cam1 =
      rotation == PairRotation::kOwn
          ? Matrix3d(world_from_cam2 *
                     pair.relative_pose->cam2_from_cam1.toRotationMatrix())
          : *problem.world_from_cam[pair.image_idx1];
  ForEachRays(bearings, pair,
              [&](const Match& match, const auto& ray1, const auto& ray2) {
                collected.rays.Add(world_from_cam1 * ray1,
                                   world_from_cam2 * ray2);
                collected.used.push_back(match);
              });
  return collected;
}

// Used for a pair without matches, whose relative pose was measured elsewhere.
void TakeDirection(const PositionProblem& problem, const ImagePair& pair,
                   BaselineDirection* baseline) {
  baseline->kind = BaselineKind::kDirection;
  baseline->direction = -(*problem.world_from_cam[pair.image_idx2] *
                          *pair.relative_pose->translation_direction);
  // Positions depend on this value only if some pairs have matches and others
  // do not.
  baseline->sigma_rad = DegToRad(0.5);
}

// Fills in everything but the images.
void MeasureBaseline(const BaselineInput& input, const ImagePair& pair,
                     PairRotation rotation, double min_sine, Random* random,
                     BaselineDirection* baseline) {
  const PositionProblem& problem = input.problem;
  if (pair.relative_pose && !pair.relative_pose->translation_direction) {
    // The pair's own rotation explains its matches. It fits them better than
    // the averaged rotation, which could suggest parallax where there is none.
    baseline->kind = BaselineKind::kNoParallax;
    return;
  }
  if (pair.relative_pose && pair.matches.empty()) {
    TakeDirection(problem, pair, baseline);
    return;
  }
  const PairRays collected =
      CollectRays(input.bearings, problem, pair, rotation);
  const double noise_rad = std::hypot(PixelRad(input.scene, pair.image_idx1),
                                      PixelRad(input.scene, pair.image_idx2)) /
                           std::sqrt(2.0);
  const BaselineMatches matches =
      PrepareMatches(collected.rays, noise_rad, min_sine);
  std::optional<Vector3d> guess;
  if (pair.relative_pose && pair.relative_pose->translation_direction) {
    guess = *problem.world_from_cam[pair.image_idx2] *
            *pair.relative_pose->translation_direction;
  }
  const auto estimate = EstimateDirection(matches, guess, random);
  if (estimate) {
    baseline->kind = BaselineKind::kDirection;
    baseline->direction = estimate->direction;
    baseline->sigma_rad = estimate->sigma_rad;
    CollectDepths(matches, *estimate, collected.used, baseline);
  } else if (10 * matches.wide.size() <= 4 * matches.normals.size()) {
    baseline->kind = BaselineKind::kNoParallax;
  }
}

}  // namespace

void SortByKeypoint(std::vector<DepthSample>* depths) {
  std::sort(depths->begin(), depths->end(),
            [](const DepthSample& a, const DepthSample& b) {
              return a.keypoint_idx != b.keypoint_idx
                         ? a.keypoint_idx < b.keypoint_idx
                         : a.log_depth < b.log_depth;
            });
}

std::vector<BaselineDirection> EstimateBaselineDirections(
    const BaselineInput& input, double min_parallax_deg, const Context& context,
    PairRotation rotation) {
  const double min_sine = std::sin(DegToRad(min_parallax_deg));
  std::vector<BaselineDirection> baselines(input.view_graph.pairs.size());
  ParallelFor(baselines.size(), context.num_threads, [&](size_t pair_idx) {
    const ImagePair& pair = input.view_graph.pairs[pair_idx];
    BaselineDirection& baseline = baselines[pair_idx];
    baseline.image_idx1 = pair.image_idx1;
    baseline.image_idx2 = pair.image_idx2;
    if (!input.pair_is_used[pair_idx] ||
        !input.problem.IsUsed(pair.image_idx1) ||
        !input.problem.IsUsed(pair.image_idx2)) {
      return;
    }
    context.CheckInterrupted();
    Random random(context.random_seed, pair_idx);
    MeasureBaseline(input, pair, rotation, min_sine, &random, &baseline);
  });
  return baselines;
}

}  // namespace mgsfm
