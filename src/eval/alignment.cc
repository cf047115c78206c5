// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "mgsfm/eval/evaluation.h"
#include "mgsfm/geometry/so3.h"
#include "mgsfm/math/statistics.h"

namespace mgsfm {
namespace {

constexpr double kOrientationWeight = 0.05;
constexpr double kOutlierFactor = 10.0;
constexpr int kNumRobustIterations = 30;
constexpr int kNumIterations = 10;

// What an image says of the similarity.
struct Sample {
  Eigen::Vector3d center;       // in the model
  Eigen::Vector3d true_center;  // in the world
  Eigen::Matrix3d rotation;     // world from model
};

Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(
      matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
  flip(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant();
  return svd.matrixU() * flip * svd.matrixV().transpose();
}

struct Moments {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Vector3d true_mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();     // true x model^T
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Zero();  // sum of rotations
  double variance = 0.0;       // of the centres in the model
  double true_variance = 0.0;  // of the true centres
  double weight = 0.0;
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

// The minimiser of (1), alternating over rotation and scale.
Sim3 FitWeighted(const std::vector<Sample>& samples,
                 const std::vector<double>& weights) {
  const Moments m = ComputeMoments(samples, weights);
  const double mu2 =
      kOrientationWeight * kOrientationWeight * m.true_variance / m.weight;
  Eigen::Matrix3d rotation = NearestRotation(m.rotation);
  double scale = 1.0;
  for (int i = 0; i < kNumIterations; ++i) {
    if (m.variance > 0.0 && m.true_variance > 0.0) {
      // |s| keeps a scale of contradictory poses from mirroring the model.
      scale = std::abs((rotation.transpose() * m.cross).trace()) / m.variance;
    }
    if (m.true_variance > 0.0) {
      rotation = NearestRotation(scale * m.cross + 0.5 * mu2 * m.rotation);
    }
  }
  return {scale, Eigen::Quaterniond(rotation),
          m.true_mean - scale * (rotation * m.mean)};
}

std::vector<double> Residuals(const std::vector<Sample>& samples,
                              const Sim3& world_from_model) {
  std::vector<double> residuals;
  residuals.reserve(samples.size());
  for (const Sample& sample : samples) {
    residuals.push_back(
        (world_from_model * sample.center - sample.true_center).norm());
  }
  return residuals;
}

}  // namespace

std::optional<Sim3> AlignPoses(const std::vector<ImagePoses>& images) {
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

  std::vector<double> weights(samples.size(), 1.0);
  Sim3 fit = FitWeighted(samples, weights);
  std::vector<double> residuals = Residuals(samples, fit);
  for (int i = 0; i < kNumRobustIterations; ++i) {
    // Least sum of distances; the floor keeps exact images from taking all.
    const double floor = 1e-3 * Median(residuals) + 1e-12;
    for (size_t k = 0; k < weights.size(); ++k) {
      weights[k] = 1.0 / std::max(residuals[k], floor);
    }
    fit = FitWeighted(samples, weights);
    residuals = Residuals(samples, fit);
  }
  const double max_residual = kOutlierFactor * Median(residuals) + 1e-12;
  for (size_t k = 0; k < weights.size(); ++k) {
    weights[k] = residuals[k] <= max_residual ? 1.0 : 0.0;
  }
  return FitWeighted(samples, weights);
}

}  // namespace mgsfm
