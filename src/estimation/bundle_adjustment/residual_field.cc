// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/residual_field.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

#include "bundle_adjustment/point_filters.h"

namespace mgsfm {
namespace {

constexpr int kNumCells = 4;  // along the larger image side
// The errors of a lens model, in larger image sides. With this value, focal
// length errors of recorded rigs have a root mean square of one standard
// deviation (docs/results/constants.md).
constexpr double kLensError = 4e-4;

struct ResidualField {
  std::array<Eigen::Vector2d, kNumCells * kNumCells> sums;
  std::array<double, kNumCells* kNumCells> weights = {};
  double squares = 0.0;
  double squares_of_exact = 0.0;  // a lower bound for exact (simulated) data

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

std::vector<Overdispersion> OverdispersionOfCameras(const Scene& scene,
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
      const size_t cell = CellOf(scene.cameras[image.camera_idx], pixel);
      field.sums[cell] += weight * residual;
      field.weights[cell] += weight;
      field.squares += weight * weight * residual.squaredNorm();
      field.squares_of_exact +=
          2.0 * std::pow(weight * kMinKeypointSigmaPx, 2.0);
    }
  }
  std::vector<Overdispersion> factors(fields.size());
  for (size_t i = 0; i < fields.size(); ++i) {
    const ResidualField& field = fields[i];
    if (!(field.squares_of_exact > 0.0)) continue;
    double sum = 0.0, square_of_weights = 0.0;
    for (size_t cell = 0; cell < field.sums.size(); ++cell) {
      sum += field.sums[cell].squaredNorm();
      square_of_weights += field.weights[cell] * field.weights[cell];
    }
    const double squares = std::max(field.squares, field.squares_of_exact);
    const Camera& camera = scene.cameras[i];
    const double error_px =
        kLensError * std::max(camera.width_px, camera.height_px);
    factors[i] = {std::max(1.0, sum / squares),
                  error_px * error_px * square_of_weights / squares};
  }
  return factors;
}

}  // namespace mgsfm
