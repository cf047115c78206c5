// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "base/random.h"
#include "base/ranges.h"
#include "geometry/decompositions.h"
#include "math/statistics.h"
#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {
namespace {

// The constants of (1) in evaluation.h.
constexpr double kOrientationWeight = 0.05;
constexpr double kOutlierFactor = 10.0;
constexpr double kMinOutlier = 0.01;
// Image pairs for the initial fit. If 80 % of the images are inliers, all pairs
// contain an outlier with probability 0.36^200.
constexpr int kNumTrials = 200;
// Numbers of reweighted fits, and of alternations between scale and rotation in
// each. Both are cheap, so they need no test of convergence.
constexpr int kNumRobustIterations = 30;
constexpr int kNumIterations = 10;
// Bound on the root mean square distance from the mean caused by rounding,
// relative to the distance of the mean from the origin.
constexpr double kRounding = 1e-10;

// The measurement of the similarity by one image.
struct Sample {
  Eigen::Vector3d center;       // in the model
  Eigen::Vector3d true_center;  // in the world
  Eigen::Matrix3d rotation;     // world_from_model
};

Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& matrix) {
  const Svd3 svd(matrix);
  Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
  flip(2, 2) = (svd.U * svd.V.transpose()).determinant();
  return svd.U * flip * svd.V.transpose();
}

struct Moments {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Vector3d true_mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();     // true x model^T
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Zero();  // sum of rotations
  double variance = 0.0;       // of the centers in the model
  double true_variance = 0.0;  // of the true centers
  double weight = 0.0;

  // Whether the estimated or the true centers differ by more than rounding.
  bool HaveExtent() const {
    return variance > kRounding * kRounding * weight * mean.squaredNorm();
  }
  bool HaveTrueExtent() const {
    return true_variance >
           kRounding * kRounding * weight * (1.0 + true_mean.squaredNorm());
  }
};

Moments ComputeMoments(const std::vector<Sample>& samples,
                       const std::vector<double>& weights) {
  Moments m;
  for (size_t i = 0; i < samples.size(); ++i) {
    m.weight += weights[i];
    m.mean += weights[i] * samples[i].center;
    m.true_mean += weights[i] * samples[i].true_center;
    m.rotation += weights[i] * samples[i].rotation;
  }
  m.mean /= m.weight;
  m.true_mean /= m.weight;
  for (size_t i = 0; i < samples.size(); ++i) {
    const Eigen::Vector3d c = samples[i].center - m.mean;
    const Eigen::Vector3d g = samples[i].true_center - m.true_mean;
    m.cross += weights[i] * g * c.transpose();
    m.variance += weights[i] * c.squaredNorm();
    m.true_variance += weights[i] * g.squaredNorm();
  }
  return m;
}

// Minimizes (1) by alternating over rotation and scale.
Sim3 FitWeighted(const std::vector<Sample>& samples,
                 const std::vector<double>& weights, bool fits_scale) {
  const Moments m = ComputeMoments(samples, weights);
  Eigen::Matrix3d rotation = NearestRotation(m.rotation);
  double scale = 1.0;
  if (m.HaveExtent() && m.HaveTrueExtent()) {
    const double mu2 =
        kOrientationWeight * kOrientationWeight * m.true_variance / m.weight;
    for (int i = 0; i < kNumIterations; ++i) {
      // |s| prevents a reflection of the model for contradictory poses.
      if (fits_scale) {
        scale = std::abs((rotation.transpose() * m.cross).trace()) / m.variance;
      }
      rotation = NearestRotation(scale * m.cross + 0.5 * mu2 * m.rotation);
    }
  }
  return {scale, Eigen::Quaterniond(rotation),
          m.true_mean - scale * (rotation * m.mean)};
}

std::vector<double> Residuals(const std::vector<Sample>& samples,
                              const Sim3& world_from_model) {
  return Transformed(samples, [&](const Sample& sample) {
    return (world_from_model * sample.center - sample.true_center).norm();
  });
}

// The root mean square distance of the true centers from their mean.
double TrueExtent(const std::vector<Sample>& samples) {
  const Moments m =
      ComputeMoments(samples, std::vector<double>(samples.size(), 1.0));
  return std::sqrt(m.true_variance / m.weight);
}

double RobustCost(const std::vector<double>& residuals, double max_residual) {
  double cost = 0.0;
  for (const double residual : residuals) {
    cost += std::min(residual, max_residual);
  }
  return cost;
}

// The fit to two images, or to all, with the lowest robust cost. The leverage
// of images far away in the model can make the fit to all images useless.
Sim3 FitRobustly(const std::vector<Sample>& samples, double max_residual,
                 bool fits_scale) {
  Sim3 best = FitWeighted(samples, std::vector<double>(samples.size(), 1.0),
                          fits_scale);
  double min_cost = RobustCost(Residuals(samples, best), max_residual);
  Random random(0);
  const auto num_samples = static_cast<uint32_t>(samples.size());
  for (int i = 0; i < kNumTrials; ++i) {
    const Sim3 fit = FitWeighted({samples[random.Index(num_samples)],
                                  samples[random.Index(num_samples)]},
                                 {1.0, 1.0}, fits_scale);
    const double cost = RobustCost(Residuals(samples, fit), max_residual);
    if (cost < min_cost) {
      min_cost = cost;
      best = fit;
    }
  }
  return best;
}

// Weights of iteratively reweighted least squares for the sum of distances
// truncated at `extent`.
std::vector<double> RobustWeights(const std::vector<double>& residuals,
                                  double extent) {
  const double median = Median(residuals);
  // The floor bounds the weights of images with zero residuals.
  const double floor = 1e-3 * median + 1e-12;
  // At least half of the images keep a positive weight.
  const double max_residual = std::max(extent, median);
  return Transformed(residuals, [&](double residual) {
    return residual <= max_residual ? 1.0 / std::max(residual, floor) : 0.0;
  });
}

}  // namespace

std::optional<Sim3> AlignPoses(const std::vector<ImagePoses>& images,
                               Alignment alignment) {
  const bool fits_scale = alignment == Alignment::kSimilarity;
  std::vector<Sample> samples;
  for (const ImagePoses& image : images) {
    if (!image.cam_from_model) continue;
    samples.push_back({image.cam_from_model->Center(),
                       image.cam_from_world.Center(),
                       (image.cam_from_world.rotation.conjugate() *
                        image.cam_from_model->rotation)
                           .toRotationMatrix()});
  }
  if (samples.empty()) return std::nullopt;
  if (alignment == Alignment::kNone) return Sim3();

  const double extent = TrueExtent(samples);
  Sim3 fit = FitRobustly(samples, extent, fits_scale);
  std::vector<double> residuals = Residuals(samples, fit);
  for (int i = 0; i < kNumRobustIterations; ++i) {
    fit = FitWeighted(samples, RobustWeights(residuals, extent), fits_scale);
    residuals = Residuals(samples, fit);
  }
  // If most images coincide, the median alone would reject all others.
  const double max_residual =
      std::max(kOutlierFactor * Median(residuals), kMinOutlier * extent) +
      1e-12;
  const std::vector<double> weights = Transformed(
      residuals,
      [&](double residual) { return residual <= max_residual ? 1.0 : 0.0; });
  return FitWeighted(samples, weights, fits_scale);
}

}  // namespace mgsfm
