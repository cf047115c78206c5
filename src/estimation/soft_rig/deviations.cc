// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/deviations.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/problem_builder.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

// Replaces the frames of separate images by the frames of the scene.
void SetFrames(const Scene& scene, const Reconstruction& rig,
               BuiltProblem* soft) {
  BuiltProblem& built = *soft;
  built.frame_idxs.clear();
  built.state.frames.clear();
  built.problem.frame_masks.clear();
  DenseNumbering frames(scene.frames.size());
  for (size_t i = 0; i < soft->image_idxs.size(); ++i) {
    const int frame_idx = scene.images[soft->image_idxs[i]].frame_idx;
    const int number = frames.NumberOf(frame_idx, &built.frame_idxs);
    if (number == static_cast<int>(built.state.frames.size())) {
      const Rigid3& pose = *rig.rig_from_world[frame_idx];
      built.state.frames.push_back({pose.rotation, pose.Center()});
      built.problem.frame_masks.emplace_back(PoseMask::Ones());
    }
    built.problem.images[i].frame = number;
  }
}

// Makes each image a sensor with a prior. sigmas are divided by sigma_px
// because residuals of keypoints are in pixels.
void SetSensors(const Scene& scene, const SoftRigModel& model,
                const std::vector<std::optional<Rigid3>>& expected,
                const std::vector<DeviationSigma>& sigmas, double sigma_px,
                BuiltProblem* soft) {
  BuiltProblem& built = *soft;
  built.sensor_idxs.clear();
  built.state.sensors.clear();
  built.problem.sensor_masks.clear();
  built.problem.sensor_priors.clear();
  for (size_t i = 0; i < soft->image_idxs.size(); ++i) {
    const int image_idx = soft->image_idxs[i];
    const Image& image = scene.images[image_idx];
    built.problem.images[i].sensor = static_cast<int>(i);
    built.state.sensors.push_back(
        *model.separate.rig_from_world[image_idx] *
        model.rig.rig_from_world[image.frame_idx]->Inverse());
    built.problem.sensor_masks.emplace_back(PoseMask::Ones());
    const DeviationSigma& sigma = sigmas[image.sensor_idx];
    built.problem.sensor_priors.push_back(
        {static_cast<int>(i), *expected[image_idx],
         sigma.rotation_rad / sigma_px, sigma.position / sigma_px});
  }
}

}  // namespace

BuiltProblem BuildSoftRigProblem(const Scene& scene, const Scene& separate,
                                 const SoftRigModel& model,
                                 const DeviationPrior& deviations,
                                 const BundleAdjustmentOptions& options,
                                 const BundlePriors& priors) {
  BuiltProblem soft = BuildProblem(separate, model.separate, options,
                                   RefinedParts::kAll, priors);
  SetFrames(scene, model.rig, &soft);
  SetSensors(scene, model, deviations.expected, deviations.sigmas,
             deviations.sigma_px, &soft);
  if (soft.problem.position_priors.empty()) {
    FixGaugeAndScale(soft.state, &soft.problem);
  }
  return soft;
}

void WriteBack(const BuiltProblem& soft, const Scene& scene,
               const std::vector<std::optional<Rigid3>>& expected,
               SoftRigModel* model) {
  const BundleState& state = soft.state;
  for (size_t i = 0; i < soft.frame_idxs.size(); ++i) {
    const FramePose& pose = state.frames[i];
    model->rig.rig_from_world[soft.frame_idxs[i]] =
        Rigid3::FromRotationAndCenter(pose.rig_from_world, pose.center);
  }
  std::vector<std::optional<Rigid3>> sensor_of_image = expected;
  for (size_t i = 0; i < soft.image_idxs.size(); ++i) {
    sensor_of_image[soft.image_idxs[i]] = state.sensors[i];
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto& frame = model->rig.rig_from_world[scene.images[i].frame_idx];
    if (!frame || !sensor_of_image[i]) continue;
    model->separate.rig_from_world[i] = *sensor_of_image[i] * *frame;
  }
  BuiltProblem points_and_cameras;
  points_and_cameras.state.points = state.points;
  points_and_cameras.state.cameras = state.cameras;
  points_and_cameras.point_idxs = soft.point_idxs;
  points_and_cameras.camera_idxs = soft.camera_idxs;
  WriteBack(points_and_cameras, &model->separate);
  model->rig.cameras = model->separate.cameras;
}

std::vector<ErrorSums> SumErrors(const Scene& scene,
                                 const Reconstruction& reconstruction) {
  const std::vector<ImageView> views = MakeImageViews(scene, reconstruction);
  std::vector<ErrorSums> sums(scene.sensors.size());
  for (const Point3D& point : reconstruction.points) {
    for (const Observation& o : point.track) {
      if (!views[o.image_idx].is_registered) continue;
      const double error_px =
          ReprojectionError(scene, views, o, point.point_in_world);
      if (!std::isfinite(error_px)) continue;
      ErrorSums& of_sensor = sums[scene.images[o.image_idx].sensor_idx];
      of_sensor.sum_px += error_px;
      ++of_sensor.num_observations;
    }
  }
  return sums;
}

std::vector<std::optional<Rigid3>> ImagePosesOf(const Scene& scene,
                                                const Reconstruction& model) {
  std::vector<std::optional<Rigid3>> cam_from_world;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    cam_from_world.push_back(model.CamFromWorld(scene, static_cast<int>(i)));
  }
  return cam_from_world;
}

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
