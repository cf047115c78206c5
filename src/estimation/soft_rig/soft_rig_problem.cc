// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/soft_rig_problem.h"

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

}  // namespace mgsfm
