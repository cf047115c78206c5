// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/image_poses.h"

namespace mgsfm {
namespace {

using RowMajor3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

void SetCamera(const RigProblemBase::Camera& camera, const CameraParams& params,
               ImagePose* pose) {
  pose->params = params.data();
  pose->projection = FindPixelProjection(camera.model);
  pose->free_params = camera.free_params.data();
  pose->num_free_params = static_cast<int>(camera.free_params.size());
  pose->num_params = InfoOf(camera.model).num_params;
  pose->is_pinhole =
      camera.model == CameraModelId::kPinhole && camera.free_params.empty();
}

}  // namespace

void ComputeImagePoses(const RigProblemBase& problem, const RigState& state,
                       std::vector<ImagePose>* poses) {
  poses->resize(problem.images.size());
  for (size_t i = 0; i < problem.images.size(); ++i) {
    const RigProblemBase::Image& image = problem.images[i];
    const RigMotion motion = problem.MotionOf(static_cast<int>(i));
    const FramePose frame = Move(state.frames[image.frame], motion);
    const Rigid3& sensor = state.sensors[image.sensor];
    ImagePose& pose = (*poses)[i];
    if (problem.held_cam_from_world.empty()) {
      const Eigen::Matrix3d S = sensor.rotation.toRotationMatrix();
      RowMajor3d::Map(pose.sensor_from_frame).noalias() =
          S * motion.rotation.toRotationMatrix();
      RowMajor3d::Map(pose.cam_from_world).noalias() =
          S * frame.rig_from_world.toRotationMatrix();
    } else {
      RowMajor3d::Map(pose.cam_from_world) = problem.held_cam_from_world[i];
    }
    Eigen::Vector3d::Map(pose.center) = frame.center;
    Eigen::Vector3d::Map(pose.translation) = sensor.translation;
    if (image.camera >= 0) {
      SetCamera(problem.cameras[image.camera], state.cameras[image.camera],
                &pose);
    }
  }
}

ImageTwist ComputeImageTwist(const ImagePose& pose, const PoseVector& frame,
                             const PoseVector& sensor) {
  using Vector = Eigen::Map<Eigen::Vector3d>;
  ImageTwist twist;
  Vector rotation(twist.rotation), shift(twist.shift);
  rotation = sensor.head<3>();
  if (!frame.head<3>().isZero(0.0)) {
    rotation.noalias() +=
        RowMajor3d::Map(pose.sensor_from_frame) * frame.head<3>();
  }
  shift = sensor.tail<3>();
  shift.noalias() -= RowMajor3d::Map(pose.cam_from_world) * frame.tail<3>();
  return twist;
}

}  // namespace mgsfm
