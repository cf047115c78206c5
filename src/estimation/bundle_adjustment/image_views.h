// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Projects points of the world into an image. References the reconstruction it
// was made from.
struct ImageView {
  bool is_registered = false;
  Eigen::Matrix3d cam_from_world = Eigen::Matrix3d::Identity();
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  CameraModelId model = CameraModelId::kPinhole;
  const double* params = nullptr;  // set if the image is registered

  // nullopt if the camera cannot see the point.
  std::optional<Eigen::Vector2d> Project(
      const Eigen::Vector3d& point,
      Eigen::Matrix<double, 2, 3>* jacobian_point = nullptr) const {
    return ProjectToPixel(model, params, cam_from_world * (point - center),
                          jacobian_point);
  }
  // Distance in pixels; infinite if the camera cannot see the point.
  double ReprojectionError(const Eigen::Vector3d& point,
                           const Eigen::Vector2d& pixel) const;
};

// Per image of the scene.
std::vector<ImageView> MakeImageViews(const Scene& scene,
                                      const Reconstruction& reconstruction);

}  // namespace mgsfm
