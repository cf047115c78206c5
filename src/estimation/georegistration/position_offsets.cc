// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/position_offsets.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "georegistration/position_registration.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector3d;
using Eigen::Vector4d;

// Unknowns: translation, rotation and scale, then the clock and the antenna.
constexpr int kScale = 6, kNumSimilarity = 7, kNumOffsets = 4;
constexpr int kNumUnknowns = kNumSimilarity + kNumOffsets;
using Rows = Eigen::Matrix<double, 3, kNumUnknowns>;
using Unknowns = Eigen::Matrix<double, kNumUnknowns, 1>;
using Normal = Eigen::Matrix<double, kNumUnknowns, kNumUnknowns>;
// Columns are directions of the four offsets.
using Basis = Eigen::Matrix<double, kNumOffsets, Eigen::Dynamic>;

constexpr size_t kNumBlocks = 16;
constexpr size_t kMinSamplesPerBlock = 5;
// Student's t for 15 degrees of freedom exceeds this in 1 of 10,000 cases.
constexpr double kMaxDeviations = 5.24;
// The 95 % quantile of the length of 3D standard normal noise.
constexpr double kHuberWidth = 2.8;
constexpr int kNumIterations = 10;
// From the fit to all samples to that without a block.
constexpr int kNumBlockIterations = 4;
// The share of the information on an offset that nothing else explains. With
// less, the errors of velocities and rotations matter more than the motion.
constexpr double kMinTellingShare = 1e-4;

struct Sample {
  Vector3d point;     // the antenna in the model
  Vector3d residual;  // from the antenna to the position
  Matrix3d axes;      // of the antenna, in the world
  double sigma = 1.0;
  std::optional<double> time_s;
  Vector3d velocity = Vector3d::Zero();
};

// The samples are in the order of frames.
std::vector<Sample> CollectSamples(const Scene& scene,
                                   const PositionPriors& priors,
                                   const Reconstruction& model) {
  std::vector<Sample> samples;
  for (const Frame& frame : scene.frames) {
    for (const int image_idx : frame.image_idxs) {
      const auto pose = model.CamFromWorld(scene, image_idx);
      const auto& prior = priors.images[image_idx];
      if (!pose || !prior) continue;
      const Vector3d point = prior->PointInWorld(*pose);
      samples.push_back(
          {point, prior->position - point,
           (pose->rotation.conjugate() * prior->cam_from_antenna.rotation)
               .toRotationMatrix(),
           std::sqrt(prior->covariance.trace() / 3.0),
           scene.images[image_idx].timestamp_s});
    }
  }
  return samples;
}

// Only the samples with a velocity.
std::vector<Sample> AddVelocities(const std::vector<Sample>& all) {
  std::vector<Sample> samples;
  for (size_t i = 1; i + 1 < all.size(); ++i) {
    const double interval_s = *all[i + 1].time_s - *all[i - 1].time_s;
    if (!(interval_s > 0.0)) continue;
    samples.push_back(all[i]);
    samples.back().velocity =
        (all[i + 1].point - all[i - 1].point) / interval_s;
  }
  return samples;
}

// The information of the samples about the offsets.
struct Information {
  Matrix4d total;  // with a known similarity
  Matrix4d left;   // with an unknown one

  bool Tells(double information, double of_all) const {
    return information > kMinTellingShare * of_all;
  }
  // The independent directions of the antenna that the samples tell, with a
  // known or unknown clock.
  Basis LeverBasis(bool knows_clock) const {
    Matrix3d of_lever = left.bottomRightCorner<3, 3>();
    if (!knows_clock) {
      const Vector3d shared = left.bottomLeftCorner<3, 1>();
      of_lever -= shared * shared.transpose() / left(0, 0);
    }
    const SymmetricEigen<Matrix3d> eigen(of_lever);
    const double mean = total.bottomRightCorner<3, 3>().trace() / 3.0;
    Basis basis(kNumOffsets, 0);
    for (int k = 0; k < 3; ++k) {
      if (!Tells(eigen.values[k], mean)) continue;
      basis.conservativeResize(Eigen::NoChange, basis.cols() + 1);
      basis.rightCols<1>() << 0.0, eigen.V.col(k);
    }
    return basis;
  }
  // Whether they tell the clock, with an antenna that is free along `lever`.
  bool TellsClock(const Basis& lever) const {
    const Eigen::RowVectorXd shared = left.row(0) * lever;
    const Eigen::MatrixXd of_lever = lever.transpose() * left * lever;
    const double explained =
        lever.cols() == 0
            ? 0.0
            : shared.dot(of_lever.ldlt().solve(shared.transpose()));
    return Tells(left(0, 0) - explained, total(0, 0));
  }
};

// Offsets along the columns of a basis.
struct Estimate {
  Eigen::VectorXd values;
  Eigen::VectorXd sigmas;

  bool IsSignificant(Eigen::Index k) const {
    return std::abs(values[k]) > kMaxDeviations * sigmas[k];
  }
};

class OffsetFit {
 public:
  OffsetFit(const std::vector<Sample>& samples, bool is_metric)
      : samples_(samples), is_metric_(is_metric) {
    for (const Sample& sample : samples) mean_ += sample.point;
    mean_ /= static_cast<double>(samples.size());
  }

  // Before any fit.
  Information Inform() const {
    const Equations start = MakeEquations(Unknowns::Zero(), std::nullopt);
    Information information;
    information.total =
        start.normal.bottomRightCorner<kNumOffsets, kNumOffsets>();
    const Eigen::Matrix<double, kNumSimilarity, kNumOffsets> shared =
        start.normal.topRightCorner<kNumSimilarity, kNumOffsets>();
    information.left =
        information.total -
        shared.transpose() *
            start.normal.topLeftCorner<kNumSimilarity, kNumSimilarity>()
                .ldlt()
                .solve(shared);
    return information;
  }

  std::optional<Estimate> Solve(const Basis& basis) const {
    if (basis.cols() == 0) return std::nullopt;
    Unknowns all = Unknowns::Zero();
    Eigen::VectorXd variances;
    for (int i = 0; i < kNumIterations; ++i) {
      variances = Step(basis, std::nullopt, &all);
    }
    Eigen::MatrixXd parts(basis.cols(), kNumBlocks);
    for (size_t block = 0; block < kNumBlocks; ++block) {
      Unknowns part = all;
      for (int i = 0; i < kNumBlockIterations; ++i) Step(basis, block, &part);
      parts.col(static_cast<Eigen::Index>(block)) =
          basis.transpose() * part.tail<kNumOffsets>();
    }
    if (!all.allFinite() || !parts.allFinite()) return std::nullopt;
    const Eigen::VectorXd spread =
        (parts.colwise() - parts.rowwise().mean()).rowwise().squaredNorm();
    constexpr double kJackknife = (kNumBlocks - 1.0) / kNumBlocks;
    return Estimate{basis.transpose() * all.tail<kNumOffsets>(),
                    variances.cwiseMax(kJackknife * spread).cwiseSqrt()};
  }

 private:
  struct Equations {
    Normal normal = Normal::Zero();
    Unknowns right = Unknowns::Zero();
  };

  Rows RowsOf(const Sample& sample) const {
    const Vector3d arm = sample.point - mean_;
    Rows rows;
    rows.leftCols<3>().setIdentity();
    rows.middleCols<3>(3) = -CrossMatrix(arm);
    rows.col(kScale) = is_metric_ ? Vector3d::Zero() : arm;
    rows.col(kNumSimilarity) = -sample.velocity;
    rows.rightCols<3>() = sample.axes;
    return rows;
  }

  // The residual in standard deviations.
  double LengthOf(const Sample& sample, const Unknowns& unknowns) const {
    return (sample.residual - RowsOf(sample) * unknowns).norm() / sample.sigma;
  }

  Equations MakeEquations(const Unknowns& unknowns,
                          std::optional<size_t> left_out) const {
    const std::vector<double> lengths = Transformed(
        samples_,
        [&](const Sample& sample) { return LengthOf(sample, unknowns); });
    const double bound = OutlierBound(Median(lengths));
    Equations equations;
    for (size_t i = 0; i < samples_.size(); ++i) {
      if (left_out == i * kNumBlocks / samples_.size()) continue;
      if (lengths[i] > bound) continue;
      const Sample& sample = samples_[i];
      const Rows rows = RowsOf(sample) / sample.sigma;
      const double weight =
          lengths[i] > kHuberWidth ? kHuberWidth / lengths[i] : 1.0;
      equations.normal += weight * rows.transpose() * rows;
      equations.right +=
          weight * rows.transpose() * sample.residual / sample.sigma;
    }
    if (is_metric_) equations.normal(kScale, kScale) = 1.0;
    return equations;
  }

  // Updates the unknowns, with offsets in the span of the basis. Returns the
  // variances along its columns.
  Eigen::VectorXd Step(const Basis& basis, std::optional<size_t> left_out,
                       Unknowns* unknowns) const {
    const Equations equations = MakeEquations(*unknowns, left_out);
    Eigen::MatrixXd columns =
        Eigen::MatrixXd::Zero(kNumUnknowns, kNumSimilarity + basis.cols());
    columns.topLeftCorner<kNumSimilarity, kNumSimilarity>().setIdentity();
    columns.bottomRightCorner(kNumOffsets, basis.cols()) = basis;
    const Eigen::LDLT<Eigen::MatrixXd> normal(
        (columns.transpose() * equations.normal * columns).eval());
    *unknowns = columns * normal.solve(columns.transpose() * equations.right);
    const Eigen::MatrixXd inverse =
        normal.solve(Eigen::MatrixXd::Identity(columns.cols(), columns.cols()));
    return inverse.diagonal().tail(basis.cols());
  }

  const std::vector<Sample>& samples_;
  const bool is_metric_;
  Vector3d mean_ = Vector3d::Zero();
};

std::optional<ClockOffset> ClockOf(const std::optional<Estimate>& estimate) {
  if (!estimate) return std::nullopt;
  return ClockOffset{estimate->values[0], estimate->sigmas[0],
                     estimate->IsSignificant(0)};
}

// From the estimates along the columns of `basis` from `first` on.
std::optional<LeverOffset> LeverOf(const std::optional<Estimate>& estimate,
                                   const Basis& basis, Eigen::Index first) {
  if (!estimate || first == basis.cols()) return std::nullopt;
  LeverOffset lever;
  for (Eigen::Index k = first; k < basis.cols(); ++k) {
    if (!estimate->IsSignificant(k)) continue;
    lever.offset += estimate->values[k] * basis.col(k).tail<3>();
  }
  if (!lever.IsSignificant()) {
    lever.sigma = estimate->sigmas.tail(basis.cols() - first).maxCoeff();
    return lever;
  }
  const Vector3d direction = lever.offset.normalized();
  for (Eigen::Index k = first; k < basis.cols(); ++k) {
    const double share = direction.dot(basis.col(k).tail<3>());
    lever.sigma = std::hypot(lever.sigma, share * estimate->sigmas[k]);
  }
  return lever;
}

bool AreSignificant(const PositionOffsets& offsets) {
  return (offsets.clock && offsets.clock->is_significant) ||
         (offsets.lever && offsets.lever->IsSignificant());
}

PositionOffsets EstimateTogether(const OffsetFit& fit,
                                 const Information& information) {
  const Basis lever = information.LeverBasis(false);
  Basis basis(kNumOffsets, lever.cols() + 1);
  basis.leftCols<1>() = Vector4d::UnitX();
  basis.rightCols(lever.cols()) = lever;
  const auto estimate = fit.Solve(basis);
  return {ClockOf(estimate), LeverOf(estimate, basis, 1), false};
}

PositionOffsets EstimateEach(const OffsetFit& fit,
                             const Information& information) {
  PositionOffsets offsets;
  if (information.TellsClock(Basis(kNumOffsets, 0))) {
    offsets.clock = ClockOf(fit.Solve(Vector4d::UnitX()));
  }
  const Basis lever = information.LeverBasis(true);
  offsets.lever = LeverOf(fit.Solve(lever), lever, 0);
  offsets.are_alternatives = offsets.clock && offsets.clock->is_significant &&
                             offsets.lever && offsets.lever->IsSignificant();
  return offsets;
}

}  // namespace

PositionOffsets EstimatePositionOffsets(const Scene& scene,
                                        const PositionPriors& priors,
                                        const Reconstruction& reconstruction,
                                        bool is_metric) {
  std::vector<Sample> samples = CollectSamples(scene, priors, reconstruction);
  const bool have_times =
      AllOf(samples, [](const Sample& s) { return s.time_s.has_value(); });
  if (have_times) samples = AddVelocities(samples);
  if (samples.size() < kNumBlocks * kMinSamplesPerBlock) return {};
  const OffsetFit fit(samples, is_metric);
  const Information information = fit.Inform();
  if (information.TellsClock(information.LeverBasis(true))) {
    PositionOffsets offsets = EstimateTogether(fit, information);
    if (AreSignificant(offsets)) return offsets;
  }
  return EstimateEach(fit, information);
}

std::string DescribeOffsets(const PositionOffsets& offsets) {
  std::string text;
  if (offsets.clock && offsets.clock->is_significant) {
    const double offset_s = offsets.clock->offset_s;
    text = Formatted(
        "the clock of the positions is %.3f +- %.3f s %s that of the images: "
        "add %.3f to prior_clock_offset_s",
        std::abs(offset_s), offsets.clock->sigma_s,
        offset_s > 0.0 ? "ahead of" : "behind", offset_s);
  }
  if (offsets.lever && offsets.lever->IsSignificant()) {
    const Vector3d& offset = offsets.lever->offset;
    if (!text.empty()) text += offsets.are_alternatives ? "; or " : "; ";
    text += Formatted(
        "the positions are those of a point %.3f +- %.3f away from the "
        "antenna: add [%.3f, %.3f, %.3f] to antenna_in_imu of "
        "body_calibration, which is the camera by default",
        offset.norm(), offsets.lever->sigma, offset.x(), offset.y(),
        offset.z());
  }
  if (offsets.are_alternatives) text += "; the motion does not tell which";
  return text;
}

}  // namespace mgsfm
