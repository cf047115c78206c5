// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// Gauge-invariant differences of two models of one scene over the images
// registered in both.
struct ModelDifference {
  int num_images = 0;
  double max_rotation_deg = 0.0;
  double max_position = 0.0;  // in units of the second model
  double scale = 1.0;         // second over first
};

// Aligns the image centers by a similarity (Umeyama). The centers must not be
// collinear.
inline ModelDifference CompareModels(const Scene& scene,
                                     const Reconstruction& model,
                                     const Reconstruction& truth) {
  std::vector<Rigid3> poses, true_poses;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto pose = model.CamFromWorld(scene, static_cast<int>(i));
    const auto true_pose = truth.CamFromWorld(scene, static_cast<int>(i));
    if (!pose || !true_pose) continue;
    poses.push_back(*pose);
    true_poses.push_back(*true_pose);
  }
  ModelDifference difference;
  difference.num_images = static_cast<int>(poses.size());
  if (poses.empty()) return difference;
  Eigen::Matrix3Xd centers(3, poses.size()), true_centers(3, poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    centers.col(i) = poses[i].Center();
    true_centers.col(i) = true_poses[i].Center();
  }
  const Eigen::Matrix4d transform = Eigen::umeyama(centers, true_centers);
  const Eigen::Matrix3d scaled_rotation = transform.topLeftCorner<3, 3>();
  difference.scale = std::cbrt(scaled_rotation.determinant());
  const Eigen::Quaterniond rotation(scaled_rotation / difference.scale);
  for (size_t i = 0; i < poses.size(); ++i) {
    const Eigen::Vector3d center =
        scaled_rotation * centers.col(i) + transform.topRightCorner<3, 1>();
    difference.max_position = std::max(difference.max_position,
                                       (center - true_centers.col(i)).norm());
    difference.max_rotation_deg =
        std::max(difference.max_rotation_deg,
                 RadToDeg(AngleBetween(poses[i].rotation,
                                       true_poses[i].rotation * rotation)));
  }
  return difference;
}

}  // namespace mgsfm
