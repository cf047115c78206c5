// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/geodesic_median.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

size_t Stride(size_t size, size_t max_size) {
  return (size + max_size - 1) / max_size;
}

// Accurate to about 1e-8 rad, which is enough to compare samples.
double FastAngle(const Quaterniond& a, const Quaterniond& b) {
  return 2.0 * std::acos(std::min(1.0, std::abs(a.dot(b))));
}

size_t FindTruncatedMedoid(const std::vector<Quaterniond>& samples,
                           const std::vector<double>& weights,
                           double truncation_rad) {
  const size_t size = samples.size();
  // Bounds the quadratic cost of the initial medoid to 2e5 angles.
  const size_t voter_stride = Stride(size, 2000);
  size_t best = 0;
  double best_cost = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < size; i += Stride(size, 100)) {
    double cost = 0.0;
    for (size_t j = 0; j < size; j += voter_stride) {
      cost += weights[j] *
              std::min(FastAngle(samples[i], samples[j]), truncation_rad);
    }
    if (cost < best_cost) {
      best_cost = cost;
      best = i;
    }
  }
  return best;
}

double SumOfDistances(const Quaterniond& rotation,
                      const std::vector<Quaterniond>& samples,
                      const std::vector<double>& weights) {
  double sum = 0.0;
  for (size_t i = 0; i < samples.size(); ++i) {
    sum += weights[i] * AngleBetween(rotation, samples[i]);
  }
  return sum;
}

Vector3d WeiszfeldStep(const Quaterniond& rotation,
                       const std::vector<Quaterniond>& samples,
                       const std::vector<double>& weights) {
  const Quaterniond inverse = rotation.conjugate();
  Vector3d pull = Vector3d::Zero();
  double stiffness = 0.0;
  double weight_here = 0.0;
  for (size_t i = 0; i < samples.size(); ++i) {
    const Vector3d v = LogSO3(inverse * samples[i]);
    const double distance = v.norm();
    // Samples closer to the estimate coincide with it. The bound is below the
    // step tolerance and above the rounding errors of a logarithm.
    if (distance <= 1e-11) {
      weight_here += weights[i];
      continue;
    }
    pull += (weights[i] / distance) * v;
    stiffness += weights[i] / distance;
  }
  const double norm = pull.norm();
  if (norm <= weight_here || stiffness == 0.0) return Vector3d::Zero();
  return (1.0 - weight_here / norm) / stiffness * pull;
}

double MedianDeviation(const Quaterniond& rotation,
                       const std::vector<Quaterniond>& samples) {
  std::vector<double> deviations;
  deviations.reserve(samples.size());
  for (const Quaterniond& sample : samples) {
    deviations.push_back(AngleBetween(rotation, sample));
  }
  return Median(std::move(deviations));
}

}  // namespace

GeodesicMedian FindGeodesicMedian(const std::vector<Quaterniond>& samples,
                                  const std::vector<double>& weights,
                                  double truncation_rad) {
  MGSFM_CHECK(!samples.empty());
  MGSFM_CHECK_EQ(samples.size(), weights.size());
  GeodesicMedian median;
  SolveSummary& summary = median.summary;
  median.rotation =
      samples[FindTruncatedMedoid(samples, weights, truncation_rad)];
  summary.initial_cost = SumOfDistances(median.rotation, samples, weights);
  summary.termination = Termination::kMaxIterations;
  // Weiszfeld's algorithm converges linearly, and slowly near a sample.
  while (summary.num_iterations < 500) {
    ++summary.num_iterations;
    const Vector3d step = WeiszfeldStep(median.rotation, samples, weights);
    median.rotation = (median.rotation * ExpSO3(step)).normalized();
    if (step.norm() <= 1e-10) {
      summary.termination = Termination::kConverged;
      break;
    }
  }
  summary.final_cost = SumOfDistances(median.rotation, samples, weights);
  if (!std::isfinite(summary.final_cost)) {
    summary.termination = Termination::kFailure;
    summary.message = "A sample is not finite.";
    return median;
  }
  median.median_deviation_rad = MedianDeviation(median.rotation, samples);
  return median;
}

}  // namespace mgsfm
