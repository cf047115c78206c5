// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/position_registration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "base/random.h"
#include "base/ranges.h"
#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The distance beyond which positions are outliers, in standard deviations.
// Normal noise in three dimensions exceeds 4 with probability 1.1e-3.
constexpr double kOutlierInSigmas = 4.0;
// Standard deviation of the upward direction if cameras are held roughly
// upright, and of measured gravity.
constexpr double kUprightSigmaRad = DegToRad(10.0);
constexpr double kGravitySigmaRad = DegToRad(1.0);

struct Sample {
  int image_idx = 0;
  Vector3d center;    // in the model
  Vector3d lever;     // to the antenna, in the axes of the model and meters
  Vector3d position;  // measured
  double sigma = 1.0;

  // The antenna in a model of this scale.
  Vector3d PointAt(double scale) const { return scale * center + lever; }
};

// The similarity fit to samples: min sum w |R (s c + l) + t - g|^2 - 2
// tr(upright R^T) up to constants.
struct FitProblem {
  std::vector<Sample> samples;
  OutlierRule outlier_rule = OutlierRule::kLeastMedian;
  bool fits_scale = true;
  Matrix3d upright;  // z d^T / sigma_up^2
};

struct RobustFit {
  Sim3 world_from_model;
  Mask is_inlier;  // per sample
};

double WeightOf(const Sample& sample) {
  return 1.0 / (sample.sigma * sample.sigma);
}

std::vector<double> ResidualsOf(const FitProblem& problem, const Sim3& fit) {
  std::vector<double> residuals;
  residuals.reserve(problem.samples.size());
  for (const Sample& sample : problem.samples) {
    const Vector3d point =
        fit.rotation * sample.PointAt(fit.scale) + fit.translation;
    residuals.push_back((point - sample.position).norm() / sample.sigma);
  }
  return residuals;
}

Mask InliersOf(const FitProblem& problem, const Sim3& fit) {
  const std::vector<double> residuals = ResidualsOf(problem, fit);
  const double bound = problem.outlier_rule == OutlierRule::kFixedBound
                           ? kOutlierInSigmas
                           : OutlierBound(Median(residuals));
  Mask is_inlier;
  is_inlier.reserve(residuals.size());
  for (const double r : residuals) is_inlier.push_back(r <= bound);
  return is_inlier;
}

// Weighted means and second moments of centers, levers and positions.
struct Moments {
  Vector3d mean = Vector3d::Zero();
  Vector3d lever_mean = Vector3d::Zero();
  Vector3d measured_mean = Vector3d::Zero();
  Matrix3d cross = Matrix3d::Zero();        // of positions and centers
  Matrix3d lever_cross = Matrix3d::Zero();  // of positions and levers
  double variance = 0.0;
  double lever_covariance = 0.0;  // of centers and levers
  double measured_variance = 0.0;
};

Moments MomentsOf(const std::vector<Sample>& samples, const Mask& is_used) {
  Moments m;
  double weight = 0.0;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (!is_used[i]) continue;
    const double w = WeightOf(samples[i]);
    m.mean += w * samples[i].center;
    m.lever_mean += w * samples[i].lever;
    m.measured_mean += w * samples[i].position;
    weight += w;
  }
  m.mean /= weight;
  m.lever_mean /= weight;
  m.measured_mean /= weight;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (!is_used[i]) continue;
    const double w = WeightOf(samples[i]);
    const Vector3d c = samples[i].center - m.mean;
    const Vector3d l = samples[i].lever - m.lever_mean;
    const Vector3d g = samples[i].position - m.measured_mean;
    m.cross += w * g * c.transpose();
    m.lever_cross += w * g * l.transpose();
    m.variance += w * c.squaredNorm();
    m.lever_covariance += w * c.dot(l);
    m.measured_variance += w * g.squaredNorm();
  }
  return m;
}

// Alternates between rotation (Kabsch) and scale, because the upright term
// makes the two depend on each other.
Sim3 FitSimilarity(const FitProblem& problem, const Mask& is_used) {
  const Moments m = MomentsOf(problem.samples, is_used);
  const bool fits_scale = problem.fits_scale && m.variance > 0.0;
  Sim3 fit;
  if (fits_scale) fit.scale = std::sqrt(m.measured_variance / m.variance);
  for (int i = 0; i < 10; ++i) {
    const Svd3 svd(fit.scale * m.cross + m.lever_cross + problem.upright);
    Matrix3d flip = Matrix3d::Identity();
    flip(2, 2) = (svd.U * svd.V.transpose()).determinant();
    fit.rotation =
        Eigen::Quaterniond(Matrix3d(svd.U * flip * svd.V.transpose()));
    if (!fits_scale) break;
    const double scale =
        ((fit.rotation.toRotationMatrix().transpose() * m.cross).trace() -
         m.lever_covariance) /
        m.variance;
    // Contradictory positions can favor a reflection.
    if (!(scale > 0.0)) break;
    fit.scale = scale;
  }
  fit.translation =
      m.measured_mean - fit.rotation * (fit.scale * m.mean + m.lever_mean);
  return fit;
}

// The cost that selects the best of all fits.
double CostOf(const FitProblem& problem, const Sim3& fit) {
  std::vector<double> residuals = ResidualsOf(problem, fit);
  if (problem.outlier_rule == OutlierRule::kLeastMedian) {
    return Median(std::move(residuals));
  }
  // The MSAC cost: the number of outliers plus the squared errors of inliers.
  double cost = 0.0;
  for (const double r : residuals) {
    cost += std::min(1.0, r * r / (kOutlierInSigmas * kOutlierInSigmas));
  }
  return cost;
}

// The best fit to samples of three, then refits to inliers.
RobustFit FitRobustly(const FitProblem& problem, uint64_t random_seed) {
  if (problem.outlier_rule == OutlierRule::kNone) {
    const Mask all(problem.samples.size(), true);
    return {FitSimilarity(problem, all), all};
  }
  Sim3 best;
  double least = std::numeric_limits<double>::infinity();
  Random random(random_seed);
  const auto size = static_cast<uint32_t>(problem.samples.size());
  // With 50 % outliers (the breakdown point of LMedS), 62 of 500 samples of
  // three are free of outliers on average; one of them has little noise.
  for (int trial = 0; trial < 500; ++trial) {
    Mask is_used(problem.samples.size(), false);
    for (int k = 0; k < 3; ++k) is_used[random.Index(size)] = true;
    const Sim3 fit = FitSimilarity(problem, is_used);
    const double cost = CostOf(problem, fit);
    if (cost >= least) continue;
    least = cost;
    best = fit;
  }
  RobustFit result{best, InliersOf(problem, best)};
  // Usually, the loop ends when the inliers do not change.
  for (int i = 0; i < 10; ++i) {
    if (result.is_inlier.Count() < 3) break;
    result.world_from_model = FitSimilarity(problem, result.is_inlier);
    Mask inliers = InliersOf(problem, result.world_from_model);
    if (inliers == result.is_inlier) break;
    result.is_inlier = std::move(inliers);
  }
  return result;
}

// Standard deviation of the rotation about the path due to positions alone.
double RotationSigma(const std::vector<Sample>& samples, const RobustFit& fit) {
  const double scale = fit.world_from_model.scale;
  Vector3d mean = Vector3d::Zero();
  double weight = 0.0;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (!fit.is_inlier[i]) continue;
    const double w = WeightOf(samples[i]);
    mean += w * samples[i].PointAt(scale);
    weight += w;
  }
  mean /= weight;
  Matrix3d scatter = Matrix3d::Zero();
  for (size_t i = 0; i < samples.size(); ++i) {
    if (!fit.is_inlier[i]) continue;
    const Vector3d c = samples[i].PointAt(scale) - mean;
    scatter += WeightOf(samples[i]) * c * c.transpose();
  }
  const SymmetricEigen<Matrix3d> eigen(scatter);
  return 1.0 / std::sqrt(std::max(eigen.values[1], 1e-12));
}

std::vector<Sample> CollectSamples(const Scene& scene,
                                   const PositionPriors& priors,
                                   const Reconstruction& reconstruction) {
  std::vector<Sample> samples;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const auto pose = reconstruction.CamFromWorld(scene, image_idx);
    if (!pose || !priors.images[i]) continue;
    const PositionMeasurement& prior = *priors.images[i];
    samples.push_back({image_idx, pose->Center(), prior.LeverInWorld(*pose),
                       prior.position,
                       std::sqrt(prior.covariance.trace() / 3.0)});
  }
  return samples;
}

// Median distance from the median position, in standard deviations.
double RelativeExtent(const std::vector<Sample>& samples) {
  const Vector3d median =
      MedianOfCoordinates(Transformed(samples, &Sample::position));
  return Median(Transformed(samples, [&](const Sample& sample) {
    return (sample.position - median).norm() / sample.sigma;
  }));
}

// z d^T / sigma_up^2, or zero if the upward direction is unknown.
Matrix3d UprightTerm(const Reconstruction& reconstruction, bool is_on_earth,
                     const std::optional<Vector3d>& measured_up) {
  if (!is_on_earth) return Matrix3d::Zero();
  if (measured_up) {
    return Vector3d::UnitZ() * measured_up->transpose() /
           (kGravitySigmaRad * kGravitySigmaRad);
  }
  Vector3d up = Vector3d::Zero();
  for (const auto& pose : reconstruction.rig_from_world) {
    if (pose) up -= pose->rotation.conjugate() * Vector3d::UnitY();
  }
  if (!(up.norm() > 0.0)) return Matrix3d::Zero();
  return Vector3d::UnitZ() * up.normalized().transpose() /
         (kUprightSigmaRad * kUprightSigmaRad);
}

// A message for the rotation about a line of positions.
const char* DescribeRotation(bool is_on_earth, bool has_gravity) {
  if (!is_on_earth) {
    return "The positions are collinear; the rotation about their line is "
           "arbitrary.";
  }
  return has_gravity ? "The positions are collinear; measured gravity "
                       "determines the rotation about their line."
                     : "The positions are collinear; the rotation about their "
                       "line assumes that cameras are upright on average.";
}

}  // namespace

double OutlierBound(double median_distance) {
  // Normal noise has a median distance of 1.54 standard deviations.
  return std::max(kOutlierInSigmas, 3.0 * median_distance);
}

PositionRegistration RegisterToPriors(const Scene& scene,
                                      const PositionPriors& priors,
                                      const RegistrationOptions& options,
                                      Reconstruction* reconstruction) {
  PositionRegistration result;
  PositionPriorSummary& summary = result.summary;
  std::vector<Sample> samples = CollectSamples(scene, priors, *reconstruction);
  summary.num_priors = static_cast<int>(samples.size());
  if (samples.size() < 3) {
    summary.message =
        "Fewer than three registered images have positions; the model is not "
        "registered to them.";
    return result;
  }
  // Twice the median distance of 3D normal noise, 1.54 standard deviations.
  if (RelativeExtent(samples) < 3.0) {
    summary.message =
        "The extent of the positions is within their errors; the model is not "
        "registered to them.";
    return result;
  }
  const bool is_on_earth = priors.origin_wgs84.has_value();
  const FitProblem problem{
      std::move(samples), options.outlier_rule, !options.is_metric,
      UprightTerm(*reconstruction, is_on_earth, options.up)};
  const RobustFit fit = FitRobustly(problem, options.random_seed);
  TransformWorld(fit.world_from_model, reconstruction);
  summary.is_registered = true;
  // Larger standard deviations of the rotation about the path are reported.
  if (RotationSigma(problem.samples, fit) > DegToRad(5.0)) {
    summary.message = DescribeRotation(is_on_earth, options.up.has_value());
  }
  result.used.images.resize(scene.images.size());
  for (size_t i = 0; i < problem.samples.size(); ++i) {
    const int image_idx = problem.samples[i].image_idx;
    if (!fit.is_inlier[i]) continue;
    result.used.images[image_idx] = priors.images[image_idx];
  }
  return result;
}

void EvaluatePositions(const Scene& scene, const PositionPriors& priors,
                       const PositionPriors& used,
                       const Reconstruction& reconstruction,
                       PositionPriorSummary* summary) {
  if (!summary->is_registered) return;
  double squared_sum = 0.0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const auto pose = reconstruction.CamFromWorld(scene, image_idx);
    if (!pose || !priors.images[i]) continue;
    const PositionMeasurement& prior = *priors.images[i];
    const Vector3d error = prior.PointInWorld(*pose) - prior.position;
    const double distance =
        std::sqrt(error.dot(prior.covariance.llt().solve(error)));
    if (distance > kOutlierInSigmas || !used.images[i]) {
      summary->outliers.push_back({image_idx, error.norm()});
    } else {
      ++summary->num_used;
      squared_sum += error.squaredNorm();
    }
  }
  if (summary->num_used > 0) {
    summary->rms = std::sqrt(squared_sum / summary->num_used);
  }
}

}  // namespace mgsfm
