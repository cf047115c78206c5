// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "features/scale_space.h"

namespace mgsfm {

using SiftDescriptor = std::array<float, 128>;

// Orientations and descriptors of points from the image gradients around them.
// Reuses its memory; use one per thread. Angles are in radians from x to y
// (clockwise, as y points down).
class GradientDescriber {
 public:
  // Dominant orientations: peaks of the histogram of gradient directions (36
  // bins) of at least 0.8 of the highest peak; at most `max_num`, the highest
  // first. Gradients are weighted by magnitude and a Gaussian of 1.5 sigma.
  std::vector<float> FindOrientations(const cv::Mat& level,
                                      const ScaleSpacePoint& point,
                                      int max_num);

  // Histograms of 8 directions in 4 x 4 cells of 3 sigma, rotated by the
  // orientation. Gradients are interpolated between the nearest bins in x, y
  // and angle and weighted by a Gaussian of 2 cells. The descriptor is
  // L2-normalized, clipped at 0.2 and normalized again. Order: rows, columns,
  // directions; these run from y to x, like Lowe's.
  SiftDescriptor Describe(const cv::Mat& level, const ScaleSpacePoint& point,
                          float orientation_rad);

 private:
  // Gradients of pixels; the first `size` elements of the arrays are valid.
  struct Gradients {
    size_t size = 0;
    std::vector<float> dx, dy;       // derivatives of the gray value
    std::vector<float> weight;       // Gaussian
    std::vector<float> column, row;  // position in cells of the descriptor
    std::vector<float> length, angle;

    // Makes room for `capacity` gradients and sets size to 0.
    void Reserve(size_t capacity);
    void ComputePolar();
  };
  // Appends the gradients of pixels [begin, end) of row y with the weight
  // exp(factor |pixel - point|^2).
  void AppendRow(const cv::Mat& level, const ScaleSpacePoint& point,
                 float factor, int y, int begin, int end);
  // The factor of that weight which depends on x, for pixels [begin, end).
  void ComputeColumnWeights(float center, float factor, int begin, int end);
  void GatherCells(const cv::Mat& level, const ScaleSpacePoint& point,
                   float orientation_rad);

  Gradients gradients_;
  int first_column_ = 0;
  std::vector<float> column_weights_;
};

}  // namespace mgsfm
