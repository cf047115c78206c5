// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/shared_calibration.h"

#include <algorithm>
#include <cmath>

#include "base/ranges.h"
#include "bundle_adjustment/problem_builder.h"
#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "soft_rig/rig_delays.h"

namespace mgsfm {
namespace {

constexpr double kMaxChance = 1e-4;
constexpr double kDegreesOfFreedom = 9.0;  // of ten blocks of frames
// The relative standard deviation of a baseline that counts as exact: small
// compared with the precision from keypoints.
constexpr double kUnitSigma = 1e-4;

double LengthInSigmas(const RigSensor& sensor) {
  const Eigen::Vector3d& t = sensor.sensor_from_rig.translation;
  const double variance =
      t.dot(sensor.covariance.bottomRightCorner<3, 3>() * t);
  return variance > 0.0 ? t.squaredNorm() / std::sqrt(variance) : 0.0;
}

// Makes the length of the baseline exact.
void DefineUnit(RigSensor* sensor) {
  const Eigen::Vector3d& t = sensor->sensor_from_rig.translation;
  PoseMatrix P = PoseMatrix::Identity();
  P.bottomRightCorner<3, 3>() -= t * t.transpose() / t.squaredNorm();
  sensor->covariance = (P * sensor->covariance * P).eval();
  sensor->covariance.bottomRightCorner<3, 3>() +=
      kUnitSigma * kUnitSigma * t * t.transpose();
}

struct EstimatedRig {
  RigSensors sensors;
  std::optional<int> unit_sensor;  // its baseline counts as exact
};

// The refined sensors of an adjusted model. Only baselines that are also in
// `allowed` define a unit of length; null allows all.
EstimatedRig EstimateRig(const Scene& scene, const Reconstruction& model,
                         CovarianceResult covariances,
                         const std::optional<RigDelays>& delays,
                         const BundleAdjustmentOptions& options,
                         const RigSensors* allowed) {
  EstimatedRig rig{RigSensors(scene.sensors.size()), std::nullopt};
  if (!covariances.is_usable) return rig;
  if (delays) AddRigErrors(scene, model, *delays, &covariances);
  double most = kRareErrorInSigmas;
  for (size_t i = 0; i < rig.sensors.size(); ++i) {
    const int idx = static_cast<int>(i);
    const auto& covariance = covariances.sensors[i];
    if (!covariance || RefineSensor(scene, idx, options).mask.isZero(0.0)) {
      continue;
    }
    rig.sensors[i] = RigSensor{*model.sensor_from_rig[i], *covariance};
    const double length = LengthInSigmas(*rig.sensors[i]);
    rig.sensors[i]->has_length = length > kRareErrorInSigmas;
    const bool is_allowed =
        !allowed || ((*allowed)[i] && (*allowed)[i]->has_length);
    if (!covariances.scale_is_fixed || !is_allowed || length <= most) continue;
    most = length;
    rig.unit_sensor = idx;
  }
  if (rig.unit_sensor) DefineUnit(&*rig.sensors[*rig.unit_sensor]);
  return rig;
}

SensorPosePrior ToPrior(const RigSensor& sensor) {
  const int size = sensor.has_length ? 6 : 3;
  PoseVector scale = PoseVector::Ones();
  if (sensor.has_length) {
    scale.tail<3>() /= sensor.sensor_from_rig.translation.norm();
  }
  const SymmetricEigen<Eigen::MatrixXd> eigen(
      (scale.asDiagonal() * sensor.covariance * scale.asDiagonal())
          .topLeftCorner(size, size));
  SensorPosePrior prior{sensor.sensor_from_rig};
  for (int k = 0; k < size; ++k) {
    const double sigma = std::sqrt(std::max(eigen.values[k], 0.0));
    // Larger standard deviations, in radians and baselines, are uninformative;
    // those below 1e-6 are within rounding errors.
    if (sigma > 10.0) continue;
    prior.sqrt_information.row(k).head(size) =
        eigen.V.col(k).cwiseProduct(scale.head(size)) / std::max(sigma, 1e-6);
  }
  return prior;
}

bool HasLength(const std::optional<SensorPosePrior>& prior) {
  return prior && !prior->sqrt_information.rightCols<3>().isZero(0.0);
}

bool HasLength(const CalibrationPrior& prior) {
  return AnyOf(prior.sensors,
               [](const auto& sensor) { return HasLength(sensor); });
}

// The probability that four times F of four and nine degrees of freedom
// exceeds `value`: more than that of three coordinates.
double ChanceOf(double value) {
  const double u = value / (value + kDegreesOfFreedom);
  const double half = 0.5 * kDegreesOfFreedom;
  return std::pow(1.0 - u, half) * (1.0 + half * u);
}

// nullopt if chance explains the rotation and the distance between the poses.
// Each is compared with its standard deviation along itself, which is never
// stricter than the test of all coordinates: that would rely on combinations of
// coordinates whose small variances model errors exceed.
std::optional<RigDifference> Compare(int sensor_idx, const RigSensor& prior,
                                     const RigSensor& sensor) {
  const PoseVector d =
      UpdateBetween(prior.sensor_from_rig, sensor.sensor_from_rig);
  const PoseMatrix C = prior.covariance + sensor.covariance;
  const auto sigma_of = [&](int first) {
    const Eigen::Vector3d axis = d.segment<3>(first).normalized();
    return std::sqrt(axis.dot(C.block<3, 3>(first, first) * axis));
  };
  const auto square = [](double x) { return x * x; };
  const double rotation = d.head<3>().norm(), distance = d.tail<3>().norm();
  RigDifference difference{sensor_idx, RadToDeg(rotation),
                           RadToDeg(sigma_of(0))};
  double chance = ChanceOf(square(rotation / sigma_of(0)));
  if (prior.has_length && sensor.has_length) {
    difference.distance = distance;
    difference.sigma_distance = sigma_of(3);
    chance = std::min(chance, ChanceOf(square(distance / sigma_of(3))));
  }
  if (2.0 * chance >= kMaxChance) return std::nullopt;
  return difference;
}

}  // namespace

void SharedCalibration::Learn(const Reconstruction& model,
                              const PositionPriors& positions,
                              const std::optional<RigDelays>& delays,
                              const BundleAdjustmentOptions& options,
                              const Context& context) {
  BundlePriors priors;
  priors.positions = positions;
  priors.calibration = PriorFor(FramesWith(model.rig_from_world));
  const EstimatedRig rig =
      EstimateRig(scene_, model,
                  ComputeCovariances(scene_, model, options, context, priors),
                  delays, options, nullptr);
  const bool shares_unit = SharesUnit(priors.calibration);
  has_unit_ = true;
  for (size_t i = 0; i < sensors_.size(); ++i) {
    if (sensors_[i] || !rig.sensors[i]) continue;
    sensors_[i] = rig.sensors[i];
    sensors_[i]->has_length &= shares_unit;
  }
  const auto sigmas =
      ComputeIntrinsicSigmas(scene_, model, options, context, priors);
  if (!sigmas) return;
  cameras_.intrinsics.resize(scene_.cameras.size());
  cameras_.intrinsic_sigmas.resize(scene_.cameras.size());
  for (size_t i = 0; i < sigmas->size(); ++i) {
    if (has_lens_[i] || (*sigmas)[i].empty()) continue;
    has_lens_[i] = true;
    cameras_.intrinsics[i] = model.cameras[i].params;
    cameras_.intrinsic_sigmas[i] = (*sigmas)[i];
  }
}

bool SharedCalibration::SharesUnit(const CalibrationPrior& prior) const {
  return !has_unit_ || HasLength(prior);
}

CalibrationPrior SharedCalibration::PriorFor(const Mask& has_frame) const {
  CalibrationPrior prior = cameras_;
  for (const Image& image : scene_.images) {
    const auto& sensor = sensors_[image.sensor_idx];
    if (!sensor || !has_frame[image.frame_idx]) continue;
    prior.sensors.resize(sensors_.size());
    if (!prior.sensors[image.sensor_idx]) {
      prior.sensors[image.sensor_idx] = ToPrior(*sensor);
    }
  }
  return prior;
}

std::vector<RigDifference> SharedCalibration::FindDifferences(
    const Reconstruction& model, const BundlePriors& priors,
    const BundleAdjustmentOptions& options, const Context& context,
    const std::function<std::optional<RigDelays>()>& estimate_delays) const {
  const CovarianceResult covariances =
      ComputeCovariances(scene_, model, options, context, priors);
  const auto compare = [&](const std::optional<RigDelays>& delays) {
    EstimatedRig rig =
        EstimateRig(scene_, model, covariances, delays, options, &sensors_);
    PoseVector scale = PoseVector::Ones();
    if (const auto unit = rig.unit_sensor) {
      scale.tail<3>() *= sensors_[*unit]->sensor_from_rig.translation.norm() /
                         rig.sensors[*unit]->sensor_from_rig.translation.norm();
    }
    std::vector<RigDifference> differences;
    for (size_t i = 0; i < sensors_.size(); ++i) {
      auto& sensor = rig.sensors[i];
      if (!sensors_[i] || !sensor) continue;
      sensor->sensor_from_rig.translation *= scale[3];
      sensor->covariance =
          (scale.asDiagonal() * sensor->covariance * scale.asDiagonal()).eval();
      sensor->has_length &= rig.unit_sensor || !covariances.scale_is_fixed;
      const auto difference =
          Compare(static_cast<int>(i), *sensors_[i], *sensor);
      if (difference) differences.push_back(*difference);
    }
    return differences;
  };
  // Delays and overdispersion can only explain differences.
  if (compare(std::nullopt).empty()) return {};
  return compare(estimate_delays());
}

std::optional<Scene> WithKnownSensors(const Scene& scene,
                                      const CalibrationPrior& prior) {
  std::optional<Scene> with_rig;
  for (size_t i = 0; i < prior.sensors.size(); ++i) {
    if (!HasLength(prior.sensors[i])) continue;
    if (!with_rig) with_rig = scene;
    with_rig->sensors[i].sensor_from_rig = prior.sensors[i]->sensor_from_rig;
  }
  return with_rig;
}

void StartAtPrior(const CalibrationPrior& prior, Reconstruction* model) {
  if (prior.sensors.empty()) return;
  double expected = 0.0, found = 0.0;
  for (size_t i = 0; i < prior.sensors.size(); ++i) {
    const auto& pose = model->sensor_from_rig[i];
    if (!HasLength(prior.sensors[i]) || !pose) continue;
    expected += prior.sensors[i]->sensor_from_rig.translation.norm();
    found += pose->translation.norm();
  }
  Sim3 scaled;
  if (found > 0.0) scaled.scale = expected / found;
  TransformWorld(scaled, model);
  for (size_t i = 0; i < prior.sensors.size(); ++i) {
    auto& pose = model->sensor_from_rig[i];
    if (!prior.sensors[i] || !pose) continue;
    const Rigid3& known = prior.sensors[i]->sensor_from_rig;
    pose->rotation = known.rotation;
    if (HasLength(prior.sensors[i])) pose->translation = known.translation;
  }
}

}  // namespace mgsfm
