// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_calibration.h"

#include <algorithm>
#include <cmath>

#include "bundle_adjustment/problem_builder.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

// Spurious information on the time offset of one image due to velocity noise,
// in 1 / interval^2. The velocity between two frames that are as noisy as the
// image has variance 2 sigma^2 / interval^2 in each of six coordinates.
constexpr double kNoiseInformation = 12.0;

}  // namespace

RigCalibration::RigCalibration(const Scene& scene,
                               const SoftRigOptions& options,
                               const BundleAdjustmentOptions& bundle_options)
    : scene_(scene),
      options_(options),
      bundle_options_(bundle_options),
      use_times_(options.method == SoftRig::kTimeOffset),
      slot_of_sensor_(scene.sensors.size(), 0),
      motions_(scene, use_times_),
      offsets_(scene.sensors.size()) {
  for (const Rig& rig : scene.rigs) {
    for (size_t k = 0; k < rig.sensor_idxs.size(); ++k) {
      slot_of_sensor_[rig.sensor_idxs[k]] = static_cast<int>(k);
    }
  }
}

Rigid3 RigCalibration::ExpectedPose(int image_idx,
                                    const Rigid3& sensor_from_rig,
                                    double offset_s) const {
  return sensor_from_rig * motions_.MotionOf(image_idx, offset_s);
}

std::vector<std::optional<Rigid3>> RigCalibration::ExpectedPoses(
    const Reconstruction& rig) const {
  std::vector<std::optional<Rigid3>> poses(scene_.images.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    const int idx = static_cast<int>(i);
    if (!rig.IsRegistered(scene_, idx)) continue;
    const int sensor_idx = scene_.images[i].sensor_idx;
    poses[i] = ExpectedPose(idx, *rig.sensor_from_rig[sensor_idx],
                            offsets_[sensor_idx].value_s);
  }
  return poses;
}

SensorJacobian RigCalibration::Jacobian(int image_idx,
                                        const Rigid3& sensor_from_rig) const {
  const int sensor_idx = scene_.images[image_idx].sensor_idx;
  const double offset_s = offsets_[sensor_idx].value_s;
  const Rigid3 motion = motions_.MotionOf(image_idx, offset_s);
  SensorJacobian jacobian = SensorJacobian::Zero();
  jacobian.leftCols<6>().setIdentity();
  jacobian.block<3, 3>(3, 0) =
      -CrossMatrix(sensor_from_rig.rotation * motion.translation);
  if (!use_times_) return jacobian;
  const double interval_s = motions_.IntervalAt(image_idx, offset_s);
  if (!std::isfinite(interval_s)) return jacobian;
  // Step of central differences, in frame intervals: small compared with the
  // interval over which velocity changes, large compared with rounding errors.
  const double h = 1e-3 * interval_s;
  jacobian.col(6) =
      DeviationOf(ExpectedPose(image_idx, sensor_from_rig, offset_s + h),
                  ExpectedPose(image_idx, sensor_from_rig, offset_s - h)) /
      (2.0 * h);
  return jacobian;
}

double RigCalibration::Update(const std::vector<FrameDeviations>& frames,
                              const std::vector<DeviationSigma>& sigmas,
                              Reconstruction* rig) {
  std::vector<Frames> frames_of_rig(scene_.rigs.size());
  for (const FrameDeviations& frame : frames) {
    const int sensor_idx = frame.images.front().sensor_idx;
    frames_of_rig[scene_.sensors[sensor_idx].rig_idx].push_back(&frame);
  }
  double largest_change_s = 0.0;
  for (size_t r = 0; r < frames_of_rig.size(); ++r) {
    if (frames_of_rig[r].empty()) continue;
    largest_change_s =
        std::max(largest_change_s,
                 UpdateRig(static_cast<int>(r), frames_of_rig[r], sigmas, rig));
  }
  return largest_change_s;
}

double RigCalibration::UpdateRig(int rig_idx, const Frames& frames,
                                 const std::vector<DeviationSigma>& sigmas,
                                 Reconstruction* rig) {
  CalibrationEquations equations(
      static_cast<int>(scene_.rigs[rig_idx].sensor_idxs.size()));
  for (const FrameDeviations* frame : frames) {
    AddFrame(*frame, sigmas, *rig, &equations);
  }
  Eigen::VectorXd mask = MaskAndPriors(rig_idx, *rig, &equations);
  if (use_times_) SelectObservableOffsets(rig_idx, frames, equations, &mask);
  return ApplyStep(rig_idx, equations.Solve(mask), mask, rig);
}

void RigCalibration::AddFrame(const FrameDeviations& frame,
                              const std::vector<DeviationSigma>& sigmas,
                              const Reconstruction& rig,
                              CalibrationEquations* equations) const {
  std::vector<int> slots;
  std::vector<PoseVector> prior_variances;
  std::vector<SensorJacobian> jacobians;
  for (const ImageDeviation& image : frame.images) {
    slots.push_back(slot_of_sensor_[image.sensor_idx]);
    prior_variances.push_back(PriorVariances(sigmas[image.sensor_idx]));
    jacobians.push_back(
        Jacobian(image.image_idx, *rig.sensor_from_rig[image.sensor_idx]));
  }
  equations->AddFrame(frame, slots, prior_variances, jacobians);
}

// Frees the refined coordinates of poses and adds their priors.
Eigen::VectorXd RigCalibration::MaskAndPriors(
    int rig_idx, const Reconstruction& rig,
    CalibrationEquations* equations) const {
  const std::vector<int>& sensor_idxs = scene_.rigs[rig_idx].sensor_idxs;
  Eigen::VectorXd mask = Eigen::VectorXd::Zero(7 * sensor_idxs.size());
  for (const int sensor_idx : sensor_idxs) {
    const int slot = slot_of_sensor_[sensor_idx];
    const RefinedSensor refined =
        RefineSensor(scene_, sensor_idx, bundle_options_);
    mask.segment<6>(7 * slot) = refined.mask;
    if (!refined.prior || !rig.sensor_from_rig[sensor_idx]) continue;
    equations->AddPrior(slot,
                        DeviationOf(refined.prior->sensor_from_rig,
                                    *rig.sensor_from_rig[sensor_idx]),
                        PriorVariances({refined.prior->sigma_rad,
                                        refined.prior->sigma_length}));
  }
  return mask;
}

// Frees the observable time offsets and sets their standard deviations. Fixing
// the unobservable offsets improves the others, which are therefore evaluated a
// second time.
void RigCalibration::SelectObservableOffsets(
    int rig_idx, const Frames& frames, const CalibrationEquations& equations,
    Eigen::VectorXd* mask) {
  const std::vector<int>& sensor_idxs = scene_.rigs[rig_idx].sensor_idxs;
  const std::vector<double> noise = InformationOfNoise(frames);
  const auto coordinate = [&](int sensor_idx) {
    return 7 * slot_of_sensor_[sensor_idx] + 6;
  };
  for (const int sensor_idx : sensor_idxs) {
    const bool is_candidate =
        !scene_.IsReference(sensor_idx) && noise[sensor_idx] > 0.0;
    (*mask)[coordinate(sensor_idx)] = is_candidate ? 1.0 : 0.0;
  }
  const double max_sigma_s =
      options_.max_time_offset_sigma * motions_.MedianInterval(rig_idx);
  for (int pass = 0; pass < 2; ++pass) {
    const Eigen::VectorXd variances = equations.Variances(*mask);
    for (const int sensor_idx : sensor_idxs) {
      std::optional<double>& sigma_s = offsets_[sensor_idx].sigma_s;
      sigma_s.reset();
      if ((*mask)[coordinate(sensor_idx)] == 0.0) continue;
      const double information =
          1.0 / variances[coordinate(sensor_idx)] - noise[sensor_idx];
      if (information * max_sigma_s * max_sigma_s >= 1.0) {
        sigma_s = 1.0 / std::sqrt(information);
      } else {
        (*mask)[coordinate(sensor_idx)] = 0.0;
      }
    }
  }
}

// Spurious information on the time offset of each sensor (kNoiseInformation).
std::vector<double> RigCalibration::InformationOfNoise(
    const Frames& frames) const {
  std::vector<double> noise(scene_.sensors.size(), 0.0);
  for (const FrameDeviations* frame : frames) {
    for (const ImageDeviation& image : frame->images) {
      const double interval_s = motions_.IntervalAt(
          image.image_idx, offsets_[image.sensor_idx].value_s);
      noise[image.sensor_idx] += kNoiseInformation / (interval_s * interval_s);
    }
  }
  return noise;
}

// Returns the largest change of a time offset.
double RigCalibration::ApplyStep(int rig_idx, const Eigen::VectorXd& step,
                                 const Eigen::VectorXd& mask,
                                 Reconstruction* rig) {
  double largest_change_s = 0.0;
  for (const int sensor_idx : scene_.rigs[rig_idx].sensor_idxs) {
    std::optional<Rigid3>& pose = rig->sensor_from_rig[sensor_idx];
    if (!pose) continue;
    const int first = 7 * slot_of_sensor_[sensor_idx];
    pose->rotation =
        (ExpSO3(step.segment<3>(first)) * pose->rotation).normalized();
    pose->translation += step.segment<3>(first + 3);
    if (!use_times_) continue;
    double& offset_s = offsets_[sensor_idx].value_s;
    // Largest change of a time offset in one step, in frame intervals: half an
    // interval stays within the neighboring segment of the trajectory.
    const double max_step_s = 0.5 * motions_.MedianInterval(rig_idx);
    const double before_s = offset_s;
    offset_s =
        mask[first + 6] == 0.0
            ? 0.0
            : offset_s + std::clamp(step[first + 6], -max_step_s, max_step_s);
    largest_change_s =
        std::max(largest_change_s, std::abs(offset_s - before_s));
  }
  return largest_change_s;
}

}  // namespace mgsfm
