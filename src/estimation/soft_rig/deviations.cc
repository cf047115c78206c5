// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/deviations.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "bundle_adjustment/problem_builder.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

// Limits a step to a factor of 5 in sigma, which keeps the quadratic model
// valid.
constexpr double kMaxVarianceFactor = 25.0;

// Sums over the images of a sensor or rig, for rotations or positions.
struct SigmaSums {
  int num_images = 0;
  double squares = 0.0;      // |x|^2
  double trace = 0.0;        // tr C
  double information = 0.0;  // n tr C^2

  void Add(const Eigen::Vector3d& x, const Eigen::Matrix3d& covariance,
           double variance, double num_images_in_frame) {
    const Eigen::Matrix3d C =
        Eigen::Matrix3d::Identity() - covariance / variance;
    const double n = num_images_in_frame / (num_images_in_frame - 1.0);
    ++num_images;
    squares += x.squaredNorm();
    trace += C.trace();
    information += n * C.squaredNorm();
  }

  double ObservedFraction() const {
    return num_images > 0 ? trace / (3.0 * num_images) : 0.0;
  }

  double UpdatedSigma(double sigma) const {
    if (!(information > 0.0)) return sigma;
    const double variance = sigma * sigma;
    const double step = (squares - variance * trace) / information;
    return std::sqrt(std::clamp(variance + step, variance / kMaxVarianceFactor,
                                variance * kMaxVarianceFactor));
  }
};

struct SensorSums {
  SigmaSums rotation, position;

  void Add(const ImageDeviation& image, const PoseMatrix& covariance,
           const PoseVector& variances, double num_images_in_frame) {
    rotation.Add(image.value.head<3>(), covariance.topLeftCorner<3, 3>(),
                 variances[0], num_images_in_frame);
    position.Add(image.value.tail<3>(), covariance.bottomRightCorner<3, 3>(),
                 variances[3], num_images_in_frame);
  }
};

}  // namespace

std::vector<DeviationSigma> UpdateSigmas(
    const std::vector<FrameDeviations>& frames,
    const std::vector<int>& rig_of_sensor,
    const std::vector<DeviationSigma>& sigmas,
    std::vector<ObservedFraction>* fractions) {
  std::vector<SensorSums> of_sensor(sigmas.size());
  // There are at most as many rigs as sensors.
  std::vector<SensorSums> of_rig(sigmas.size());
  for (const FrameDeviations& frame : frames) {
    for (size_t i = 0; i < frame.images.size(); ++i) {
      const ImageDeviation& image = frame.images[i];
      const auto first = static_cast<Eigen::Index>(6 * i);
      const PoseMatrix covariance = frame.covariance.block<6, 6>(first, first);
      const PoseVector variances = PriorVariances(sigmas[image.sensor_idx]);
      const auto num_images = static_cast<double>(frame.images.size());
      of_sensor[image.sensor_idx].Add(image, covariance, variances, num_images);
      of_rig[rig_of_sensor[image.sensor_idx]].Add(image, covariance, variances,
                                                  num_images);
    }
  }
  std::vector<DeviationSigma> updated;
  fractions->clear();
  for (size_t s = 0; s < sigmas.size(); ++s) {
    // The relative standard error of a sigma from 3n samples is 1 / sqrt(6n):
    // 13 % for 10 images.
    const SensorSums& sums = of_sensor[s].rotation.num_images >= 10
                                 ? of_sensor[s]
                                 : of_rig[rig_of_sensor[s]];
    updated.push_back({sums.rotation.UpdatedSigma(sigmas[s].rotation_rad),
                       sums.position.UpdatedSigma(sigmas[s].position)});
    fractions->push_back(
        {sums.rotation.ObservedFraction(), sums.position.ObservedFraction()});
  }
  return updated;
}

PoseVector PriorVariances(const DeviationSigma& sigma) {
  PoseVector variances;
  variances.head<3>().setConstant(sigma.rotation_rad * sigma.rotation_rad);
  variances.tail<3>().setConstant(sigma.position * sigma.position);
  return variances;
}

CalibrationEquations::CalibrationEquations(int num_sensors)
    : matrix_(Eigen::MatrixXd::Zero(6 * num_sensors, 6 * num_sensors)),
      vector_(Eigen::VectorXd::Zero(6 * num_sensors)) {}

void CalibrationEquations::AddFrame(
    const FrameDeviations& frame, const std::vector<int>& slots,
    const std::vector<PoseVector>& prior_variances,
    const std::vector<PoseMatrix>& jacobians) {
  for (size_t i = 0; i < slots.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(6 * i);
    const PoseVector inverse_i = prior_variances[i].cwiseInverse();
    vector_.segment<6>(6 * slots[i]) +=
        jacobians[i].transpose() *
        inverse_i.cwiseProduct(frame.images[i].value);
    for (size_t j = 0; j < slots.size(); ++j) {
      const auto column = static_cast<Eigen::Index>(6 * j);
      const PoseVector inverse_j = prior_variances[j].cwiseInverse();
      PoseMatrix weight =
          -(inverse_i.asDiagonal() * frame.covariance.block<6, 6>(row, column) *
            inverse_j.asDiagonal());
      if (i == j) weight.diagonal() += inverse_i;
      matrix_.block<6, 6>(6 * slots[i], 6 * slots[j]) +=
          jacobians[i].transpose() * weight * jacobians[j];
    }
  }
}

void CalibrationEquations::AddPrior(int slot, const PoseVector& change,
                                    const PoseVector& variances) {
  const PoseVector inverse = variances.cwiseInverse();
  matrix_.diagonal().segment<6>(6 * slot) += inverse;
  vector_.segment<6>(6 * slot) += inverse.cwiseProduct(change);
}

// Fixed coordinates get a unit diagonal, so the matrix stays invertible.
Eigen::VectorXd CalibrationEquations::Solve(const Eigen::VectorXd& mask) const {
  Eigen::MatrixXd masked = mask.asDiagonal() * matrix_ * mask.asDiagonal();
  // Relative to the diagonal; regularizes unconstrained coordinates.
  masked.diagonal() *= 1.0 + 1e-9;
  for (Eigen::Index i = 0; i < mask.size(); ++i) {
    if (!(masked(i, i) > 0.0)) masked(i, i) = 1.0;
  }
  return masked.ldlt().solve(mask.cwiseProduct(vector_));
}

namespace {

using Frames = std::vector<const FrameDeviations*>;

// D_i: the motion of the rig from its frame to the image.
Rigid3 MotionInRig(const Scene& scene, const Reconstruction& rig,
                   int image_idx) {
  if (rig.motions.empty()) return {};
  const Rigid3& frame = *rig.rig_from_world[scene.images[image_idx].frame_idx];
  return Move(frame, rig.motions[image_idx]) * frame.Inverse();
}

// The position of each sensor in its rig.
std::vector<int> SlotsOfSensors(const Scene& scene) {
  std::vector<int> slots(scene.sensors.size(), 0);
  for (const Rig& rig : scene.rigs) {
    for (size_t k = 0; k < rig.sensor_idxs.size(); ++k) {
      slots[rig.sensor_idxs[k]] = static_cast<int>(k);
    }
  }
  return slots;
}

void AddFrame(const Scene& scene, const FrameDeviations& frame,
              const std::vector<DeviationSigma>& sigmas,
              const std::vector<int>& slot_of_sensor, const Reconstruction& rig,
              CalibrationEquations* equations) {
  std::vector<int> slots;
  std::vector<PoseVector> prior_variances;
  std::vector<PoseMatrix> jacobians;
  for (const ImageDeviation& image : frame.images) {
    slots.push_back(slot_of_sensor[image.sensor_idx]);
    prior_variances.push_back(PriorVariances(sigmas[image.sensor_idx]));
    jacobians.push_back(ExpectedPoseJacobian(scene, rig, image.image_idx));
  }
  equations->AddFrame(frame, slots, prior_variances, jacobians);
}

// Adds the prior of a sensor and returns its refined coordinates.
PoseMask AddSensor(const Scene& scene, int sensor_idx, int slot,
                   const BundleAdjustmentOptions& options,
                   const Reconstruction& rig, CalibrationEquations* equations) {
  const RefinedSensor refined = RefineSensor(scene, sensor_idx, options);
  const auto& pose = rig.sensor_from_rig[sensor_idx];
  if (refined.prior && pose) {
    equations->AddPrior(slot,
                        UpdateBetween(*pose, refined.prior->sensor_from_rig),
                        PriorVariances({refined.prior->sigma_rad,
                                        refined.prior->sigma_length}));
  }
  return refined.mask;
}

}  // namespace

std::vector<std::optional<Rigid3>> ExpectedPoses(const Scene& scene,
                                                 const Reconstruction& rig) {
  std::vector<std::optional<Rigid3>> poses(scene.images.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    if (!rig.IsRegistered(scene, image_idx)) continue;
    poses[i] = *rig.sensor_from_rig[scene.images[i].sensor_idx] *
               MotionInRig(scene, rig, image_idx);
  }
  return poses;
}

PoseMatrix ExpectedPoseJacobian(const Scene& scene, const Reconstruction& rig,
                                int image_idx) {
  const Rigid3& sensor =
      *rig.sensor_from_rig[scene.images[image_idx].sensor_idx];
  PoseMatrix jacobian = PoseMatrix::Identity();
  jacobian.block<3, 3>(3, 0) = -CrossMatrix(
      sensor.rotation * MotionInRig(scene, rig, image_idx).translation);
  return jacobian;
}

void UpdateExtrinsics(const Scene& scene,
                      const std::vector<FrameDeviations>& frames,
                      const std::vector<DeviationSigma>& sigmas,
                      const BundleAdjustmentOptions& options,
                      Reconstruction* rig) {
  const std::vector<int> slots = SlotsOfSensors(scene);
  std::vector<Frames> frames_of_rig(scene.rigs.size());
  for (const FrameDeviations& frame : frames) {
    const int sensor_idx = frame.images.front().sensor_idx;
    frames_of_rig[scene.sensors[sensor_idx].rig_idx].push_back(&frame);
  }
  for (size_t r = 0; r < frames_of_rig.size(); ++r) {
    if (frames_of_rig[r].empty()) continue;
    const std::vector<int>& sensor_idxs = scene.rigs[r].sensor_idxs;
    CalibrationEquations equations(static_cast<int>(sensor_idxs.size()));
    for (const FrameDeviations* frame : frames_of_rig[r]) {
      AddFrame(scene, *frame, sigmas, slots, *rig, &equations);
    }
    Eigen::VectorXd mask(6 * sensor_idxs.size());
    for (const int sensor_idx : sensor_idxs) {
      mask.segment<6>(6 * slots[sensor_idx]) = AddSensor(
          scene, sensor_idx, slots[sensor_idx], options, *rig, &equations);
    }
    const Eigen::VectorXd step = equations.Solve(mask);
    for (const int sensor_idx : sensor_idxs) {
      auto& pose = rig->sensor_from_rig[sensor_idx];
      if (pose) pose = Updated(*pose, step.segment<6>(6 * slots[sensor_idx]));
    }
  }
}

}  // namespace mgsfm
