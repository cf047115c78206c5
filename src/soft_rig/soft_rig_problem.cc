// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/soft_rig_problem.h"

#include <utility>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

// The frames of the scene that the images of the problem are in.
void SetFrames(const Scene& scene, const Reconstruction& rig,
               SoftRigProblem* loose) {
  BuiltProblem& built = loose->built;
  built.frame_idxs.clear();
  built.state.frames.clear();
  built.problem.frame_masks.clear();
  std::vector<int> number(scene.frames.size(), -1);
  for (size_t i = 0; i < loose->image_idxs.size(); ++i) {
    const int frame_idx = scene.images[loose->image_idxs[i]].frame_idx;
    if (number[frame_idx] < 0) {
      number[frame_idx] = static_cast<int>(built.frame_idxs.size());
      built.frame_idxs.push_back(frame_idx);
      const Rigid3& pose = *rig.rig_from_world[frame_idx];
      built.state.frames.push_back({pose.rotation, pose.Center()});
      built.problem.frame_masks.emplace_back(PoseMask::Ones());
    }
    built.problem.images[i].frame = number[frame_idx];
  }
}

void SetSensors(const Scene& scene, const LooseModel& model,
                const std::vector<std::optional<Rigid3>>& expected,
                const std::vector<Spread>& spreads, double sigma_px,
                SoftRigProblem* loose) {
  BuiltProblem& built = loose->built;
  built.sensor_idxs.clear();
  built.state.sensors.clear();
  built.problem.sensor_masks.clear();
  built.problem.sensor_priors.clear();
  for (size_t i = 0; i < loose->image_idxs.size(); ++i) {
    const int image_idx = loose->image_idxs[i];
    const Image& image = scene.images[image_idx];
    built.problem.images[i].sensor = static_cast<int>(i);
    built.state.sensors.push_back(
        *model.separate.rig_from_world[image_idx] *
        model.rig.rig_from_world[image.frame_idx]->Inverse());
    built.problem.sensor_masks.emplace_back(PoseMask::Ones());
    const Spread& spread = spreads[image.sensor_idx];
    built.problem.sensor_priors.push_back(
        {static_cast<int>(i), *expected[image_idx],
         spread.rotation_rad / sigma_px, spread.position / sigma_px});
  }
}

}  // namespace

SoftRigProblem BuildLooseProblem(
    const Scene& scene, const Scene& separate, const LooseModel& model,
    const std::vector<std::optional<Rigid3>>& expected,
    const std::vector<Spread>& spreads, double sigma_px,
    const BundleAdjustmentOptions& options, const BundlePriors& priors) {
  SoftRigProblem loose;
  loose.built = BuildProblem(separate, model.separate, options,
                             RefinedParts::kAll, priors);
  // Frames of separate images are numbered as these are.
  for (const RigProblemBase::Image& image : loose.built.problem.images) {
    loose.image_idxs.push_back(loose.built.frame_idxs[image.frame]);
  }
  SetFrames(scene, model.rig, &loose);
  SetSensors(scene, model, expected, spreads, sigma_px, &loose);
  if (loose.built.problem.position_priors.empty()) {
    FixGaugeAndScale(loose.built.state, &loose.built.problem);
  }
  return loose;
}

void WriteBack(const SoftRigProblem& loose, const Scene& scene,
               const std::vector<std::optional<Rigid3>>& expected,
               LooseModel* model) {
  const BundleState& state = loose.built.state;
  for (size_t i = 0; i < loose.built.frame_idxs.size(); ++i) {
    const FramePose& pose = state.frames[i];
    model->rig.rig_from_world[loose.built.frame_idxs[i]] =
        Rigid3::FromRotationAndCenter(pose.rig_from_world, pose.center);
  }
  std::vector<std::optional<Rigid3>> sensor_of_image = expected;
  for (size_t i = 0; i < loose.image_idxs.size(); ++i) {
    sensor_of_image[loose.image_idxs[i]] = state.sensors[i];
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto& frame = model->rig.rig_from_world[scene.images[i].frame_idx];
    if (!frame || !sensor_of_image[i]) continue;
    model->separate.rig_from_world[i] = *sensor_of_image[i] * *frame;
  }
  BuiltProblem points_and_cameras;
  points_and_cameras.state.points = state.points;
  points_and_cameras.state.cameras = state.cameras;
  points_and_cameras.point_idxs = loose.built.point_idxs;
  points_and_cameras.camera_idxs = loose.built.camera_idxs;
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
