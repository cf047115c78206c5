// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/observation_terms.h"

namespace mgsfm {
namespace {

// d/dw of a residual whose derivative by y is `by_y` when y <- Exp(w) y, that
// is, -by_y [y]_x: row by row y x by_y.
Eigen::Matrix<double, 2, 3> ByRotation(
    const Eigen::Vector3d& y, const Eigen::Matrix<double, 2, 3>& by_y) {
  Eigen::Matrix<double, 2, 3> by_w;
  for (int i = 0; i < 2; ++i) {
    by_w(i, 0) = y.y() * by_y(i, 2) - y.z() * by_y(i, 1);
    by_w(i, 1) = y.z() * by_y(i, 0) - y.x() * by_y(i, 2);
    by_w(i, 2) = y.x() * by_y(i, 1) - y.y() * by_y(i, 0);
  }
  return by_w;
}

}  // namespace

std::vector<ImagePose> ComputeImagePoses(const BundleProblem& problem,
                                         const BundleState& state) {
  std::vector<ImagePose> poses;
  poses.reserve(problem.images.size());
  for (const BundleProblem::Image& image : problem.images) {
    const FramePose& frame = state.frames[image.frame];
    const Rigid3& sensor = state.sensors[image.sensor];
    ImagePose pose;
    pose.sensor_from_rig = sensor.rotation.toRotationMatrix();
    pose.cam_from_world =
        pose.sensor_from_rig * frame.rig_from_world.toRotationMatrix();
    pose.center = frame.center;
    pose.translation = sensor.translation;
    pose.model = problem.cameras[image.camera].model;
    pose.params = state.cameras[image.camera].data();
    poses.push_back(pose);
  }
  return poses;
}

std::optional<Eigen::Vector2d> EvaluateResidual(const ImagePose& pose,
                                                const Eigen::Vector3d& point,
                                                const Eigen::Vector2d& pixel) {
  const Eigen::Vector3d x =
      pose.cam_from_world * (point - pose.center) + pose.translation;
  std::optional<Eigen::Vector2d> residual =
      ProjectToPixel(pose.model, pose.params, x);
  if (residual) *residual -= pixel;
  return residual;
}

bool EvaluateTerms(const ImagePose& pose, const Eigen::Vector3d& point,
                   const Eigen::Vector2d& pixel, bool with_params,
                   ObservationTerms* terms) {
  const Eigen::Vector3d y = pose.cam_from_world * (point - pose.center);
  const std::optional<Eigen::Vector2d> projected = ProjectToPixel(
      pose.model, pose.params, y + pose.translation, &terms->projection,
      with_params ? &terms->params : nullptr);
  if (!projected) return false;
  terms->residual = *projected - pixel;
  terms->rotation = ByRotation(y, terms->projection);
  terms->point = terms->projection * pose.cam_from_world;
  return true;
}

void FillColumns(const BundleProblem& problem,
                 const BundleProblem::Image& image, const ImagePose& pose,
                 const ObservationTerms& terms, const ColumnLayout& layout,
                 ObservationColumns* columns) {
  if (layout.frame >= 0) {
    const PoseMask& mask = problem.frame_masks[image.frame];
    auto frame = columns->middleCols<6>(layout.frame);
    frame.leftCols<3>().noalias() = terms.rotation * pose.sensor_from_rig;
    frame.rightCols<3>() = -terms.point;
    frame.array().rowwise() *= mask.transpose().array();
  }
  if (layout.sensor >= 0) {
    const PoseMask& mask = problem.sensor_masks[image.sensor];
    auto sensor = columns->middleCols<6>(layout.sensor);
    sensor.leftCols<3>() = terms.rotation;
    sensor.rightCols<3>() = terms.projection;
    sensor.array().rowwise() *= mask.transpose().array();
  }
  if (layout.camera >= 0) {
    const std::vector<int>& params = problem.cameras[image.camera].free_params;
    for (size_t i = 0; i < params.size(); ++i) {
      columns->col(layout.camera + i) = terms.params.col(params[i]);
    }
  }
}

}  // namespace mgsfm
