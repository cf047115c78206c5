// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/residual_field.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>

#include "bundle_adjustment/image_views.h"

namespace mgsfm {
namespace {

constexpr int kNumCells = 4;  // along the larger image side

struct ResidualField {
  std::array<Eigen::Vector2d, kNumCells * kNumCells> sums;
  double squares = 0.0;

  ResidualField() { sums.fill(Eigen::Vector2d::Zero()); }
};

size_t CellOf(const Camera& camera, const Eigen::Vector2d& pixel) {
  const int side_px = std::max(camera.width_px, camera.height_px);
  const auto index = [&](double value) {
    const int i = static_cast<int>(kNumCells * value / side_px);
    return static_cast<size_t>(std::clamp(i, 0, kNumCells - 1));
  };
  return kNumCells * index(pixel.y()) + index(pixel.x());
}

}  // namespace

std::vector<double> OverdispersionOfCameras(const Scene& scene,
                                            const Reconstruction& model,
                                            double loss_scale_px) {
  const std::vector<ImageView> views = MakeImageViews(scene, model);
  std::vector<ResidualField> fields(scene.cameras.size());
  for (const Point3D& point : model.points) {
    for (const Observation& o : point.track) {
      const ImageView& view = views[o.image_idx];
      if (!view.is_registered) continue;
      const Image& image = scene.images[o.image_idx];
      const Eigen::Vector2d pixel =
          image.keypoints_px[o.keypoint_idx].cast<double>();
      const auto projected = view.Project(point.point_in_world);
      if (!projected) continue;
      const Eigen::Vector2d residual = *projected - pixel;
      const double weight = 1.0 / (1.0 + residual.squaredNorm() /
                                             (loss_scale_px * loss_scale_px));
      ResidualField& field = fields[image.camera_idx];
      field.sums[CellOf(scene.cameras[image.camera_idx], pixel)] +=
          weight * residual;
      field.squares += weight * weight * residual.squaredNorm();
    }
  }
  std::vector<double> factors;
  for (const ResidualField& field : fields) {
    double sum = 0.0;
    for (const Eigen::Vector2d& of_cell : field.sums) {
      sum += of_cell.squaredNorm();
    }
    factors.push_back(field.squares > 0.0 ? std::max(1.0, sum / field.squares)
                                          : 1.0);
  }
  return factors;
}

}  // namespace mgsfm
