// SPDX-License-Identifier: BSD-3-Clause
#include "translation/relative_translation.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "base/parallel.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/random.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Typical error of given rotations. It displaces all rays of an image alike, so
// more matches do not help against it.
constexpr double kRotationSigma = DegToRad(0.05);
constexpr double kMaxDirectionSigma = DegToRad(15.0);
constexpr double kMinSampson = 1e-4;  // of |b x g1|^2 + |b x g2|^2
constexpr int kMinNumParallax = 8;
constexpr int kMaxNumHypotheses = 30;
constexpr size_t kMaxNumScored = 200;

class MotionEstimator {
 public:
  // noise_rad is the error of a good ray, min_sine the least |n| that counts.
  MotionEstimator(const RayMatches& matches, double noise_rad, double min_sine)
      : rays1_(matches.rays1),
        rays2_(matches.rays2),
        max_residual_(2.0 * noise_rad + kRotationSigma),
        min_sine_(std::max(min_sine, 3.0 * noise_rad)) {
    for (size_t m = 0; m < rays1_.size(); ++m) {
      normals_.push_back(rays1_[m].cross(rays2_[m]));
      if (normals_[m].norm() > min_sine_) wide_.push_back(m);
    }
  }

  // Fills all but the images and depths.
  void Estimate(const std::optional<Vector3d>& guess, Random* random,
                BaselineDirection* motion) {
    motion->kind = BaselineKind::kUnused;
    if (FindDirection(guess, random)) {
      motion->kind = BaselineKind::kDirection;
      motion->direction = direction_;
      motion->sigma_rad = sigma_rad_;
    } else if (10 * wide_.size() <= 4 * normals_.size()) {
      motion->kind = BaselineKind::kNoParallax;
    }
  }

  // Depths in baselines along both rays; nullopt unless the match has parallax,
  // agrees with the direction and is in front of both cameras.
  std::optional<Eigen::Vector2d> Depths(size_t m) const {
    if (!(normals_[m].norm() > min_sine_)) return std::nullopt;
    if (std::abs(Residual(direction_, m)) > inlier_residual_) {
      return std::nullopt;
    }
    const Eigen::Vector2d depths = SignedDepths(m);
    if (depths.minCoeff() <= 0.0) return std::nullopt;
    return depths;
  }

 private:
  bool FindDirection(const std::optional<Vector3d>& guess, Random* random);
  void TryHypothesis(const Vector3d& hypothesis);
  int NumHypotheses() const;
  void Refine();
  void UpdateNoise();
  bool ChooseSign();
  bool ComputeSigma();

  // Of unit vectors |b x g|^2 = 1 - (b . g)^2.
  double SampsonNorm2(const Vector3d& b, size_t m) const {
    const double c1 = b.dot(rays1_[m]);
    const double c2 = b.dot(rays2_[m]);
    return std::max(2.0 - c1 * c1 - c2 * c2, kMinSampson);
  }
  double SquaredResidual(const Vector3d& b, size_t m) const {
    const double e = b.dot(normals_[m]);
    return e * e / SampsonNorm2(b, m);
  }
  double Residual(const Vector3d& b, size_t m) const {
    return b.dot(normals_[m]) / std::sqrt(SampsonNorm2(b, m));
  }
  double GemanMcClure(double squared_residual) const {
    const double denominator =
        1.0 + squared_residual / (inlier_residual_ * inlier_residual_);
    return 1.0 / (denominator * denominator);
  }
  Eigen::Vector2d SignedDepths(size_t m) const {
    const Vector3d& n = normals_[m];
    return Eigen::Vector2d(direction_.cross(rays2_[m]).dot(n),
                           direction_.cross(rays1_[m]).dot(n)) /
           n.squaredNorm();
  }

  const std::vector<Vector3d>& rays1_;
  const std::vector<Vector3d>& rays2_;
  const double max_residual_;
  const double min_sine_;
  std::vector<Vector3d> normals_;
  std::vector<size_t> wide_;  // matches with parallax
  Vector3d direction_ = Vector3d::Zero();
  double score_ = 0.0;
  double inlier_ratio_ = 0.0;
  double residual_sigma_ = 0.0;
  double inlier_residual_ = 0.0;
  double sigma_rad_ = 0.0;
  std::vector<double> sizes_;  // scratch
};

bool MotionEstimator::FindDirection(const std::optional<Vector3d>& guess,
                                    Random* random) {
  if (wide_.size() < kMinNumParallax) return false;
  score_ = std::numeric_limits<double>::infinity();
  if (guess) TryHypothesis(*guess);
  const auto num_wide = static_cast<uint32_t>(wide_.size());
  for (int i = 0; i < NumHypotheses(); ++i) {
    const Vector3d& n1 = normals_[wide_[random->Index(num_wide)]];
    const Vector3d& n2 = normals_[wide_[random->Index(num_wide)]];
    TryHypothesis(n1.cross(n2));
  }
  if (!std::isfinite(score_)) return false;
  Refine();
  return ChooseSign() && ComputeSigma();
}

void MotionEstimator::TryHypothesis(const Vector3d& hypothesis) {
  const double norm = hypothesis.norm();
  if (!(norm > 1e-12)) return;
  const Vector3d b = hypothesis / norm;
  const double max2 = max_residual_ * max_residual_;
  double score = 0.0;
  int num_scored = 0, num_inliers = 0;
  // Matches without parallax agree with everything; the others decide.
  for (size_t k = 0; k < wide_.size(); k += 1 + wide_.size() / kMaxNumScored) {
    const double residual2 = SquaredResidual(b, wide_[k]);
    score += std::min(residual2, max2);
    ++num_scored;
    num_inliers += residual2 < max2;
  }
  const size_t stride = 1 + normals_.size() / kMaxNumScored;
  for (size_t m = 0; m < normals_.size() && score < score_; m += stride) {
    score += std::min(SquaredResidual(b, m), max2);
  }
  if (score < score_) {
    score_ = score;
    direction_ = b;
    inlier_ratio_ = static_cast<double>(num_inliers) / num_scored;
  }
}

// As many as it takes to draw two inliers together, all but surely.
int MotionEstimator::NumHypotheses() const {
  constexpr double kLogFailure = -9.2;  // of 1e-4
  const double success = std::min(inlier_ratio_ * inlier_ratio_, 0.99);
  if (success * kMaxNumHypotheses < -kLogFailure) return kMaxNumHypotheses;
  return static_cast<int>(std::ceil(kLogFailure / std::log1p(-success)));
}

void MotionEstimator::UpdateNoise() {
  sizes_.clear();
  const double max2 = max_residual_ * max_residual_;
  for (size_t m = 0; m < normals_.size(); ++m) {
    const double residual2 = SquaredResidual(direction_, m);
    if (residual2 < max2) sizes_.push_back(std::sqrt(residual2));
  }
  residual_sigma_ = sizes_.empty() ? max_residual_ : RobustSigma<1>(sizes_);
  inlier_residual_ = std::clamp(3.0 * residual_sigma_, 1e-6, max_residual_);
}

void MotionEstimator::Refine() {
  constexpr int kMaxNumIterations = 20;
  constexpr double kMinStep = 1e-6;
  for (int i = 0; i < kMaxNumIterations; ++i) {
    UpdateNoise();
    Matrix3d M = Matrix3d::Zero();
    Matrix3d G = Matrix3d::Zero();
    double sum = 0.0;
    for (size_t m = 0; m < normals_.size(); ++m) {
      const double norm2 = SampsonNorm2(direction_, m);
      const double e = direction_.dot(normals_[m]);
      const double weight = GemanMcClure(e * e / norm2) / norm2;
      M.noalias() += (weight * normals_[m]) * normals_[m].transpose();
      G.noalias() += (weight * rays1_[m]) * rays1_[m].transpose();
      G.noalias() += (weight * rays2_[m]) * rays2_[m].transpose();
      sum += weight;
    }
    Matrix3d N = 2.0 * sum * Matrix3d::Identity() - G;
    N += 1e-9 * N.trace() * Matrix3d::Identity();
    const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix3d> eigen(M, N);
    Vector3d next = eigen.eigenvectors().col(0).normalized();
    if (!next.allFinite()) return;
    if (next.dot(direction_) < 0.0) next = -next;
    const double step = (next - direction_).norm();
    direction_ = next;
    if (step < kMinStep) return;
  }
}

bool MotionEstimator::ChooseSign() {
  size_t num_agreeing = 0, num_positive = 0, num_negative = 0;
  for (const size_t m : wide_) {
    if (std::abs(Residual(direction_, m)) > inlier_residual_) continue;
    ++num_agreeing;
    const Eigen::Vector2d depths = SignedDepths(m);
    num_positive += depths.minCoeff() > 0.0;
    num_negative += depths.maxCoeff() < 0.0;
  }
  if (num_negative > num_positive) direction_ = -direction_;
  const size_t num_good = std::max(num_positive, num_negative);
  return num_good >= kMinNumParallax && 10 * num_good >= 7 * num_agreeing &&
         2 * num_good >= wide_.size();
}

bool MotionEstimator::ComputeSigma() {
  Matrix3d information = Matrix3d::Zero();
  std::vector<double> sines;
  for (const size_t m : wide_) {
    const double residual2 = SquaredResidual(direction_, m);
    if (residual2 > inlier_residual_ * inlier_residual_) continue;
    information += GemanMcClure(residual2) / SampsonNorm2(direction_, m) *
                   normals_[m] * normals_[m].transpose();
    sines.push_back(normals_[m].norm());
  }
  Eigen::Matrix<double, 3, 2> tangent;
  tangent.col(0) = direction_.unitOrthogonal();
  tangent.col(1) = direction_.cross(tangent.col(0));
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(
      tangent.transpose() * information * tangent);
  const double least = eigen.eigenvalues()[0];
  if (!(least > 0.0)) return false;
  sigma_rad_ = std::hypot(residual_sigma_ / std::sqrt(least),
                          kRotationSigma / Median(std::move(sines)));
  return sigma_rad_ < kMaxDirectionSigma;
}

double NoiseRad(const Scene& scene, int image_idx) {
  const Camera& camera = scene.cameras[scene.images[image_idx].camera_idx];
  return 1.0 / PixelsPerRadian(camera.model, camera.params.data());
}

class PairMotionStage {
 public:
  PairMotionStage(const Scene& scene, const Bearings& bearings,
                  const PositionProblem& problem, double min_parallax_deg,
                  uint64_t random_seed)
      : scene_(scene),
        bearings_(bearings),
        problem_(problem),
        min_sine_(std::sin(DegToRad(min_parallax_deg))),
        random_seed_(random_seed) {}

  void Run(const ImagePair& pair, size_t pair_idx,
           BaselineDirection* motion) const {
    if (pair.relative_pose && !pair.relative_pose->translation_direction) {
      // Its own rotation explains it, which is more exact than the averaged
      // one.
      motion->kind = BaselineKind::kNoParallax;
      return;
    }
    const int i = pair.image_idx1, j = pair.image_idx2;
    std::vector<Match> used;
    const RayMatches matches = CollectRays(pair, &used);
    const double noise = std::hypot(NoiseRad(scene_, i), NoiseRad(scene_, j));
    MotionEstimator estimator(matches, noise / std::sqrt(2.0), min_sine_);
    std::optional<Vector3d> guess;
    if (pair.relative_pose && pair.relative_pose->translation_direction) {
      guess = *problem_.world_from_cam[j] *
              *pair.relative_pose->translation_direction;
    }
    Random random(random_seed_, pair_idx);
    estimator.Estimate(guess, &random, motion);
    if (motion->kind == BaselineKind::kDirection) {
      CollectDepths(estimator, used, motion);
    }
  }

 private:
  RayMatches CollectRays(const ImagePair& pair,
                         std::vector<Match>* used) const {
    RayMatches matches;
    for (const Match& match : pair.matches) {
      const int keypoint1 = static_cast<int>(match.keypoint_idx1);
      const int keypoint2 = static_cast<int>(match.keypoint_idx2);
      if (!bearings_.HasRay(pair.image_idx1, keypoint1) ||
          !bearings_.HasRay(pair.image_idx2, keypoint2)) {
        continue;
      }
      matches.rays1.push_back(*problem_.world_from_cam[pair.image_idx1] *
                              bearings_.Ray(pair.image_idx1, keypoint1));
      matches.rays2.push_back(*problem_.world_from_cam[pair.image_idx2] *
                              bearings_.Ray(pair.image_idx2, keypoint2));
      used->push_back(match);
    }
    return matches;
  }

  static void CollectDepths(const MotionEstimator& estimator,
                            const std::vector<Match>& used,
                            BaselineDirection* motion) {
    for (size_t m = 0; m < used.size(); ++m) {
      const auto depths = estimator.Depths(m);
      if (!depths) continue;
      motion->depths[0].push_back({static_cast<int>(used[m].keypoint_idx1),
                                   static_cast<float>(std::log((*depths)[0]))});
      motion->depths[1].push_back({static_cast<int>(used[m].keypoint_idx2),
                                   static_cast<float>(std::log((*depths)[1]))});
    }
    for (auto& depths : motion->depths) {
      std::sort(depths.begin(), depths.end(),
                [](const DepthSample& a, const DepthSample& b) {
                  return a.keypoint_idx != b.keypoint_idx
                             ? a.keypoint_idx < b.keypoint_idx
                             : a.log_depth < b.log_depth;
                });
    }
  }

  const Scene& scene_;
  const Bearings& bearings_;
  const PositionProblem& problem_;
  const double min_sine_;
  const uint64_t random_seed_;
};

}  // namespace

std::vector<BaselineDirection> EstimateBaselineDirections(
    const Scene& scene, const Bearings& bearings, const ViewGraph& view_graph,
    const Mask& pair_is_used, const PositionProblem& problem,
    double min_parallax_deg, const Context& context) {
  const PairMotionStage stage(scene, bearings, problem, min_parallax_deg,
                              context.random_seed);
  std::vector<BaselineDirection> motions(view_graph.pairs.size());
  ParallelFor(motions.size(), context.num_threads, [&](size_t pair_idx) {
    const ImagePair& pair = view_graph.pairs[pair_idx];
    BaselineDirection& motion = motions[pair_idx];
    motion.image_idx1 = pair.image_idx1;
    motion.image_idx2 = pair.image_idx2;
    if (!pair_is_used[pair_idx] || !problem.IsUsed(pair.image_idx1) ||
        !problem.IsUsed(pair.image_idx2)) {
      return;
    }
    context.CheckInterrupted();
    stage.Run(pair, pair_idx, &motion);
  });
  return motions;
}

}  // namespace mgsfm
