// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/clock_offset.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/so3.h"
#include "georegistration/position_registration.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Unknowns: translation, rotation, scale, offset.
constexpr int kNumUnknowns = 8;
constexpr int kScale = 6, kOffset = 7;
using Rows = Eigen::Matrix<double, 3, kNumUnknowns>;
using Unknowns = Eigen::Matrix<double, kNumUnknowns, 1>;
using Normal = Eigen::Matrix<double, kNumUnknowns, kNumUnknowns>;

constexpr size_t kNumBlocks = 16;
constexpr size_t kMinSamplesPerBlock = 5;
// Student's t for 15 degrees of freedom exceeds this in 1 of 10,000 cases.
constexpr double kMaxDeviations = 5.24;
// The 95 % quantile of the length of 3D standard normal noise.
constexpr double kHuberWidth = 2.8;
constexpr int kNumIterations = 10;
// The share of the information on the offset that a similarity does not
// explain. With less, the errors of velocities matter more than the motion.
constexpr double kMinTellingShare = 1e-4;

struct TimedSample {
  double time_s = 0.0;
  Vector3d center;
  Vector3d residual;  // from the center to the position
  double sigma = 1.0;
  Vector3d velocity = Vector3d::Zero();
};

std::vector<TimedSample> CollectTimedSamples(const Scene& scene,
                                             const PositionPriors& priors,
                                             const Reconstruction& model) {
  std::vector<TimedSample> all;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto pose = model.CamFromWorld(scene, static_cast<int>(i));
    const auto& prior = priors.images[i];
    if (!pose || !prior || !scene.images[i].timestamp_s) continue;
    all.push_back({*scene.images[i].timestamp_s, pose->Center(),
                   prior->position - pose->Center(),
                   std::sqrt(prior->covariance.trace() / 3.0)});
  }
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) {
    return a.time_s < b.time_s;
  });
  std::vector<TimedSample> samples;
  for (size_t i = 1; i + 1 < all.size(); ++i) {
    const double interval_s = all[i + 1].time_s - all[i - 1].time_s;
    if (!(interval_s > 0.0)) continue;
    samples.push_back(all[i]);
    samples.back().velocity =
        (all[i + 1].center - all[i - 1].center) / interval_s;
  }
  return samples;
}

class OffsetFit {
 public:
  OffsetFit(const std::vector<TimedSample>& samples, bool is_metric)
      : samples_(samples), is_metric_(is_metric) {
    for (const TimedSample& sample : samples) mean_ += sample.center;
    mean_ /= static_cast<double>(samples.size());
  }

  // Solves without the samples of a block; nullopt if the motion does not
  // determine the offset.
  struct Result {
    double offset_s = 0.0;
    double sigma_s = 0.0;
  };
  std::optional<Result> Solve(std::optional<size_t> left_out) const {
    Unknowns unknowns = Unknowns::Zero();
    std::optional<Result> result;
    for (int i = 0; i < kNumIterations; ++i) {
      result = Step(left_out, &unknowns);
      if (!result) return std::nullopt;
    }
    return result;
  }

 private:
  Rows RowsOf(const TimedSample& sample) const {
    const Vector3d offset = sample.center - mean_;
    Rows rows;
    rows.leftCols<3>().setIdentity();
    rows.middleCols<3>(3) = -CrossMatrix(offset);
    rows.col(kScale) = is_metric_ ? Vector3d::Zero() : offset;
    rows.col(kOffset) = -sample.velocity;
    return rows;
  }

  // The residual in standard deviations.
  double LengthOf(const TimedSample& sample, const Unknowns& unknowns) const {
    return (sample.residual - RowsOf(sample) * unknowns).norm() / sample.sigma;
  }

  std::vector<double> Lengths(const Unknowns& unknowns) const {
    std::vector<double> lengths;
    for (const TimedSample& sample : samples_) {
      lengths.push_back(LengthOf(sample, unknowns));
    }
    return lengths;
  }

  std::optional<Result> Step(std::optional<size_t> left_out,
                             Unknowns* unknowns) const {
    const double bound = OutlierBound(Median(Lengths(*unknowns)));
    Normal normal = Normal::Zero();
    Unknowns right = Unknowns::Zero();
    for (size_t i = 0; i < samples_.size(); ++i) {
      if (left_out == i * kNumBlocks / samples_.size()) continue;
      const TimedSample& sample = samples_[i];
      const double length = LengthOf(sample, *unknowns);
      if (length > bound) continue;
      const Rows rows = RowsOf(sample) / sample.sigma;
      const Vector3d measured = sample.residual / sample.sigma;
      const double weight = length > kHuberWidth ? kHuberWidth / length : 1.0;
      normal += weight * rows.transpose() * rows;
      right += weight * rows.transpose() * measured;
    }
    if (is_metric_) normal(kScale, kScale) = 1.0;
    const auto similarity = normal.topLeftCorner<kOffset, kOffset>().ldlt();
    const auto shared = normal.topRightCorner<kOffset, 1>();
    const double information =
        normal(kOffset, kOffset) - shared.dot(similarity.solve(shared));
    if (!(information > kMinTellingShare * normal(kOffset, kOffset))) {
      return std::nullopt;
    }
    *unknowns = normal.ldlt().solve(right);
    if (!unknowns->allFinite()) return std::nullopt;
    return Result{(*unknowns)[kOffset], 1.0 / std::sqrt(information)};
  }

  const std::vector<TimedSample>& samples_;
  const bool is_metric_;
  Vector3d mean_ = Vector3d::Zero();
};

}  // namespace

std::optional<ClockOffset> EstimateClockOffset(
    const Scene& scene, const PositionPriors& priors,
    const Reconstruction& reconstruction, bool is_metric) {
  const std::vector<TimedSample> samples =
      CollectTimedSamples(scene, priors, reconstruction);
  if (samples.size() < kNumBlocks * kMinSamplesPerBlock) return std::nullopt;
  const OffsetFit fit(samples, is_metric);
  const auto all = fit.Solve(std::nullopt);
  if (!all) return std::nullopt;
  std::vector<double> offsets_s;
  double mean_s = 0.0;
  for (size_t block = 0; block < kNumBlocks; ++block) {
    const auto part = fit.Solve(block);
    if (!part) return std::nullopt;
    offsets_s.push_back(part->offset_s);
    mean_s += part->offset_s / kNumBlocks;
  }
  double variance_s2 = 0.0;
  for (const double offset_s : offsets_s) {
    variance_s2 += (offset_s - mean_s) * (offset_s - mean_s) *
                   (kNumBlocks - 1) / kNumBlocks;
  }
  ClockOffset result;
  result.offset_s = all->offset_s;
  result.sigma_s = std::max(all->sigma_s, std::sqrt(variance_s2));
  for (const TimedSample& sample : samples) {
    result.speed += sample.velocity.squaredNorm();
  }
  result.speed = std::sqrt(result.speed / static_cast<double>(samples.size()));
  result.is_significant =
      std::abs(result.offset_s) > kMaxDeviations * result.sigma_s;
  return result;
}

}  // namespace mgsfm
