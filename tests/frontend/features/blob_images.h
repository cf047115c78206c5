// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "base/random.h"
#include "features/sift.h"

namespace mgsfm {

// Gaussian blobs on gray: an analytic image that can be drawn rotated and
// scaled without resampling.
struct Blob {
  Eigen::Vector2d center;
  double sigma = 1.0;
  double contrast = 0.0;  // of 1
};

// x -> scale R(angle) x + translation.
struct Similarity {
  double scale = 1.0;
  double angle_rad = 0.0;
  Eigen::Vector2d translation = Eigen::Vector2d::Zero();

  Eigen::Vector2d operator*(const Eigen::Vector2d& x) const {
    const double c = std::cos(angle_rad);
    const double s = std::sin(angle_rad);
    return scale *
               Eigen::Vector2d(c * x.x() - s * x.y(), s * x.x() + c * x.y()) +
           translation;
  }
};

// Positions in [0, width] x [0, height].
inline std::vector<Blob> RandomBlobs(int num, int width, int height,
                                     uint64_t seed) {
  Random random(seed);
  std::vector<Blob> blobs;
  for (int i = 0; i < num; ++i) {
    const double x = random.Uniform(0.0, width);
    const double y = random.Uniform(0.0, height);
    const double sigma = 1.5 * std::exp(random.Uniform(0.0, 1.6));
    const double sign = random.Uniform() < 0.5 ? -1.0 : 1.0;
    blobs.push_back({{x, y}, sigma, sign * random.Uniform(0.05, 0.3)});
  }
  return blobs;
}

// The center of the first pixel is (0.5, 0.5).
inline GrayImage RenderBlobs(const std::vector<Blob>& blobs, int width,
                             int height,
                             const Similarity& image_from_plane = {}) {
  Eigen::ArrayXXd sum = Eigen::ArrayXXd::Constant(height, width, 0.5);
  for (const Blob& blob : blobs) {
    const Eigen::Vector2d center = image_from_plane * blob.center;
    const double sigma = image_from_plane.scale * blob.sigma;
    const double radius = 5.0 * sigma;
    const auto clamp = [](double value, int size) {
      return static_cast<int>(std::clamp(value, 0.0, 1.0 * size));
    };
    const int x_end = clamp(center.x() + radius, width);
    const int y_end = clamp(center.y() + radius, height);
    for (int y = clamp(center.y() - radius, height); y < y_end; ++y) {
      for (int x = clamp(center.x() - radius, width); x < x_end; ++x) {
        const Eigen::Vector2d offset =
            Eigen::Vector2d(x + 0.5, y + 0.5) - center;
        sum(y, x) += blob.contrast *
                     std::exp(-0.5 * offset.squaredNorm() / (sigma * sigma));
      }
    }
  }
  return (255.0 * sum).round().max(0.0).min(255.0).cast<uint8_t>();
}

}  // namespace mgsfm
