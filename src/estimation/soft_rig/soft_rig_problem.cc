// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/soft_rig_problem.h"

#include <utility>

#include "bundle_adjustment/problem_builder.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

// Replaces the frames of separate images by the frames of the scene.
void SetFrames(const Scene& scene, const Reconstruction& rig,
               SoftRigProblem* soft) {
  BuiltProblem& built = soft->built;
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
                SoftRigProblem* soft) {
  BuiltProblem& built = soft->built;
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

SoftRigProblem BuildSoftRigProblem(const Scene& scene, const Scene& separate,
                                   const SoftRigModel& model,
                                   const DeviationPrior& deviations,
                                   const BundleAdjustmentOptions& options,
                                   const BundlePriors& priors) {
  SoftRigProblem soft;
  soft.built = BuildProblem(separate, model.separate, options,
                            RefinedParts::kAll, priors);
  // In the scene of separate images, frames and images have the same indices.
  for (const RigProblemBase::Image& image : soft.built.problem.images) {
    soft.image_idxs.push_back(soft.built.frame_idxs[image.frame]);
  }
  SetFrames(scene, model.rig, &soft);
  SetSensors(scene, model, deviations.expected, deviations.sigmas,
             deviations.sigma_px, &soft);
  if (soft.built.problem.position_priors.empty()) {
    FixGaugeAndScale(soft.built.state, &soft.built.problem);
  }
  return soft;
}

void WriteBack(const SoftRigProblem& soft, const Scene& scene,
               const std::vector<std::optional<Rigid3>>& expected,
               SoftRigModel* model) {
  const BundleState& state = soft.built.state;
  for (size_t i = 0; i < soft.built.frame_idxs.size(); ++i) {
    const FramePose& pose = state.frames[i];
    model->rig.rig_from_world[soft.built.frame_idxs[i]] =
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
  points_and_cameras.point_idxs = soft.built.point_idxs;
  points_and_cameras.camera_idxs = soft.built.camera_idxs;
  WriteBack(points_and_cameras, &model->separate);
  model->rig.cameras = model->separate.cameras;
}

PoseVector DeviationOf(const Rigid3& pose, const Rigid3& expected) {
  PoseVector deviation;
  deviation.head<3>() = LogSO3(pose.rotation * expected.rotation.conjugate());
  deviation.tail<3>() = pose.translation - expected.translation;
  return deviation;
}

}  // namespace mgsfm
