// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/common_motion.h"

#include <algorithm>
#include <cmath>

#include "bundle/problem_builder.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

// Of the time between frames, for numerical derivatives.
constexpr double kDerivativeStep = 1e-3;
// Most that a time offset changes at once, in times between frames.
constexpr double kMaxStep = 0.5;
// What noise of frames alone tells of the offset of an image, at most, in units
// of the inverse squared time between frames: six coordinates of a velocity
// from two frames that are each as noisy as an image.
constexpr double kNoiseInformation = 12.0;

}  // namespace

CommonMotion::CommonMotion(const Scene& scene, const SoftRigOptions& options,
                           const BundleAdjustmentOptions& bundle_options)
    : scene_(scene),
      options_(options),
      bundle_options_(bundle_options),
      use_times_(options.method == SoftRig::kTimeOffset),
      number_of_sensor_(scene.sensors.size(), 0),
      motions_(scene, use_times_),
      offsets_(scene.sensors.size()) {
  for (const Rig& rig : scene.rigs) {
    for (size_t k = 0; k < rig.sensor_idxs.size(); ++k) {
      number_of_sensor_[rig.sensor_idxs[k]] = static_cast<int>(k);
    }
  }
}

Rigid3 CommonMotion::ExpectedPose(int image_idx, const Rigid3& sensor_from_rig,
                                  double offset_s) const {
  return sensor_from_rig * motions_.MotionOf(image_idx, offset_s);
}

std::vector<std::optional<Rigid3>> CommonMotion::ExpectedPoses(
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

SensorJacobian CommonMotion::Jacobian(int image_idx,
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
  const double h = kDerivativeStep * interval_s;
  jacobian.col(6) =
      DeviationOf(ExpectedPose(image_idx, sensor_from_rig, offset_s + h),
                  ExpectedPose(image_idx, sensor_from_rig, offset_s - h)) /
      (2.0 * h);
  return jacobian;
}

double CommonMotion::Update(const std::vector<FrameDeviations>& frames,
                            const std::vector<Spread>& spreads,
                            Reconstruction* rig) {
  std::vector<Frames> of_rig(scene_.rigs.size());
  for (const FrameDeviations& frame : frames) {
    const int sensor_idx = frame.images.front().sensor_idx;
    of_rig[scene_.sensors[sensor_idx].rig_idx].push_back(&frame);
  }
  double largest_change_s = 0.0;
  for (size_t r = 0; r < of_rig.size(); ++r) {
    if (of_rig[r].empty()) continue;
    largest_change_s =
        std::max(largest_change_s,
                 UpdateRig(static_cast<int>(r), of_rig[r], spreads, rig));
  }
  return largest_change_s;
}

double CommonMotion::UpdateRig(int rig_idx, const Frames& frames,
                               const std::vector<Spread>& spreads,
                               Reconstruction* rig) {
  CommonEquations equations(
      static_cast<int>(scene_.rigs[rig_idx].sensor_idxs.size()));
  for (const FrameDeviations* frame : frames) {
    AddFrame(*frame, spreads, *rig, &equations);
  }
  Eigen::VectorXd mask = MaskAndPriors(rig_idx, *rig, &equations);
  if (use_times_) JudgeOffsets(rig_idx, frames, equations, &mask);
  return ApplyStep(rig_idx, equations.Solve(mask), mask, rig);
}

void CommonMotion::AddFrame(const FrameDeviations& frame,
                            const std::vector<Spread>& spreads,
                            const Reconstruction& rig,
                            CommonEquations* equations) const {
  std::vector<int> numbers;
  std::vector<PoseVector> prior_variances;
  std::vector<SensorJacobian> jacobians;
  for (const ImageDeviation& image : frame.images) {
    numbers.push_back(number_of_sensor_[image.sensor_idx]);
    prior_variances.push_back(PriorVariances(spreads[image.sensor_idx]));
    jacobians.push_back(
        Jacobian(image.image_idx, *rig.sensor_from_rig[image.sensor_idx]));
  }
  equations->AddFrame(frame, numbers, prior_variances, jacobians);
}

// Frees what is refined of poses.
Eigen::VectorXd CommonMotion::MaskAndPriors(int rig_idx,
                                            const Reconstruction& rig,
                                            CommonEquations* equations) const {
  const std::vector<int>& sensor_idxs = scene_.rigs[rig_idx].sensor_idxs;
  Eigen::VectorXd mask = Eigen::VectorXd::Zero(7 * sensor_idxs.size());
  for (const int sensor_idx : sensor_idxs) {
    const int number = number_of_sensor_[sensor_idx];
    const RefinedSensor refined =
        RefineSensor(scene_, sensor_idx, bundle_options_);
    mask.segment<6>(7 * number) = refined.mask;
    if (!refined.prior || !rig.sensor_from_rig[sensor_idx]) continue;
    equations->AddPrior(number,
                        DeviationOf(refined.prior->sensor_from_rig,
                                    *rig.sensor_from_rig[sensor_idx]),
                        PriorVariances({refined.prior->sigma_rad,
                                        refined.prior->sigma_length}));
  }
  return mask;
}

// Frees the time offsets that are observable, and sets their standard
// deviations. An offset that is not leaves the others better determined, so
// these are judged again.
void CommonMotion::JudgeOffsets(int rig_idx, const Frames& frames,
                                const CommonEquations& equations,
                                Eigen::VectorXd* mask) {
  const std::vector<int>& sensor_idxs = scene_.rigs[rig_idx].sensor_idxs;
  const std::vector<double> noise = NoiseInformation(frames);
  const auto place = [&](int sensor_idx) {
    return 7 * number_of_sensor_[sensor_idx] + 6;
  };
  for (const int sensor_idx : sensor_idxs) {
    const bool is_tried =
        !scene_.IsReference(sensor_idx) && noise[sensor_idx] > 0.0;
    (*mask)[place(sensor_idx)] = is_tried ? 1.0 : 0.0;
  }
  const double most_s =
      options_.max_time_offset_sigma * motions_.MedianInterval(rig_idx);
  for (const bool is_last : {false, true}) {
    const Eigen::VectorXd variances = equations.Variances(*mask);
    for (const int sensor_idx : sensor_idxs) {
      std::optional<double>& sigma_s = offsets_[sensor_idx].sigma_s;
      sigma_s.reset();
      if ((*mask)[place(sensor_idx)] == 0.0) continue;
      const double information =
          1.0 / variances[place(sensor_idx)] - noise[sensor_idx];
      if (information * most_s * most_s >= 1.0) {
        sigma_s = 1.0 / std::sqrt(information);
      } else {
        (*mask)[place(sensor_idx)] = 0.0;
      }
    }
    if (is_last) break;
  }
}

// Per sensor of the scene.
std::vector<double> CommonMotion::NoiseInformation(const Frames& frames) const {
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
double CommonMotion::ApplyStep(int rig_idx, const Eigen::VectorXd& step,
                               const Eigen::VectorXd& mask,
                               Reconstruction* rig) {
  double largest_change_s = 0.0;
  for (const int sensor_idx : scene_.rigs[rig_idx].sensor_idxs) {
    std::optional<Rigid3>& pose = rig->sensor_from_rig[sensor_idx];
    if (!pose) continue;
    const int first = 7 * number_of_sensor_[sensor_idx];
    pose->rotation =
        (ExpSO3(step.segment<3>(first)) * pose->rotation).normalized();
    pose->translation += step.segment<3>(first + 3);
    if (!use_times_) continue;
    double& offset_s = offsets_[sensor_idx].value_s;
    const double most_s = kMaxStep * motions_.MedianInterval(rig_idx);
    const double before_s = offset_s;
    offset_s = mask[first + 6] == 0.0
                   ? 0.0
                   : offset_s + std::clamp(step[first + 6], -most_s, most_s);
    largest_change_s =
        std::max(largest_change_s, std::abs(offset_s - before_s));
  }
  return largest_change_s;
}

}  // namespace mgsfm
