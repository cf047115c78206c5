// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/image_views.h"

#include <limits>

namespace mgsfm {

double ImageView::ReprojectionError(const Eigen::Vector3d& point,
                                    const Eigen::Vector2d& pixel) const {
  const std::optional<Eigen::Vector2d> projected = Project(point);
  if (!projected) return std::numeric_limits<double>::infinity();
  return (*projected - pixel).norm();
}

std::vector<ImageView> MakeImageViews(const Scene& scene,
                                      const Reconstruction& reconstruction) {
  std::vector<ImageView> views(scene.images.size());
  for (size_t i = 0; i < views.size(); ++i) {
    const std::optional<Rigid3> pose =
        reconstruction.CamFromWorld(scene, static_cast<int>(i));
    if (!pose) continue;
    const Camera& camera = reconstruction.cameras[scene.images[i].camera_idx];
    views[i] = {true, pose->rotation.toRotationMatrix(), pose->Center(),
                camera.model, camera.params.data()};
  }
  return views;
}

}  // namespace mgsfm
