// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Projects points with the poses and cameras of a model.
class Projector {
 public:
  Projector(const Scene& scene, const Reconstruction& reconstruction);

  const std::optional<Rigid3>& CamFromWorld(int image_idx) const {
    return cam_from_world_[image_idx];
  }
  // Projection minus keypoint. nullopt if the image has no pose or the camera
  // does not see the point.
  std::optional<Eigen::Vector2d> ResidualPx(
      const Observation& observation,
      const Eigen::Vector3d& point_in_world) const;

 private:
  const Scene& scene_;
  const Reconstruction& reconstruction_;
  std::vector<std::optional<Rigid3>> cam_from_world_;
};

struct ImageStatistics {
  size_t num_points = 0;
  size_t num_errors = 0;  // of the points that the camera sees
  double sum_errors_px = 0.0;

  std::optional<double> MeanErrorPx() const {
    if (num_errors == 0) return std::nullopt;
    return sum_errors_px / static_cast<double>(num_errors);
  }
};

// Residuals in one part of the image plane.
struct ImageCell {
  size_t num_residuals = 0;
  double sum_errors_px = 0.0;
  Eigen::Vector2d sum_residuals_px = Eigen::Vector2d::Zero();
};

struct SensorStatistics {
  static constexpr int kNumColumns = 24;  // of cells in the error map
  // The histogram ends at 4 px, the default of max_max_error.
  static constexpr double kBinPx = 0.1;
  static constexpr size_t kNumBins = 40;  // the last one takes larger errors

  size_t num_images = 0;
  size_t num_registered = 0;
  ImageStatistics errors;
  std::array<size_t, kNumBins> error_histogram = {};
  int num_rows = 1;
  std::vector<ImageCell> cells;  // row by row
};

struct ModelStatistics {
  std::vector<ImageStatistics> images;
  std::vector<SensorStatistics> sensors;
  std::vector<size_t> num_tracks_of_length;
  size_t num_registered_images = 0;
  size_t num_registered_frames = 0;
  size_t num_observations = 0;
  ImageStatistics errors;
};

// Linear in observations.
ModelStatistics ComputeStatistics(const Scene& scene,
                                  const Reconstruction& reconstruction,
                                  const Projector& projector,
                                  const Context& context);

}  // namespace mgsfm
