// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_calibration.h"

#include "bundle_adjustment/problem_builder.h"
#include "geometry/so3.h"

namespace mgsfm {
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
  std::vector<SensorJacobian> jacobians;
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
                        DeviationOf(refined.prior->sensor_from_rig, *pose),
                        PriorVariances({refined.prior->sigma_rad,
                                        refined.prior->sigma_length}));
  }
  return refined.mask;
}

void Move(const PoseVector& change, Rigid3* sensor_from_rig) {
  sensor_from_rig->rotation =
      (ExpSO3(change.head<3>()) * sensor_from_rig->rotation).normalized();
  sensor_from_rig->translation += change.tail<3>();
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

SensorJacobian ExpectedPoseJacobian(const Scene& scene,
                                    const Reconstruction& rig, int image_idx) {
  const Rigid3& sensor =
      *rig.sensor_from_rig[scene.images[image_idx].sensor_idx];
  SensorJacobian jacobian = SensorJacobian::Identity();
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
      if (pose) Move(step.segment<6>(6 * slots[sensor_idx]), &*pose);
    }
  }
}

}  // namespace mgsfm
