// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "features/scale_space.h"

namespace mgsfm {

using SiftDescriptor = std::array<float, 128>;

// Describes points by the gradients around them. Reuses its memory, so each
// thread has one of its own. Angles are in radians, from x to y (clockwise, as
// y points down).
class GradientDescriber {
 public:
  // Directions that prevail around the point: peaks of a histogram of 36 bins
  // that have at least 0.8 of the highest; at most `max_num`, the highest
  // first. Gradients are weighted by their length and a Gaussian of 1.5 sigma.
  std::vector<float> FindOrientations(const cv::Mat& level,
                                      const ScaleSpacePoint& point,
                                      int max_num);

  // Histograms of 8 directions in 4 x 4 cells of 3 sigma, turned by the
  // orientation, each gradient shared between the nearest bins in x, y and
  // angle, and weighted by a Gaussian of 2 cells. L2-normalised, clipped at
  // 0.2, and normalised again. Rows, columns, then directions, which run from
  // y to x, as Lowe's do.
  SiftDescriptor Describe(const cv::Mat& level, const ScaleSpacePoint& point,
                          float orientation_rad);

 private:
  // Gradients of some pixels, as arrays of which the first `size` are in use.
  struct Gradients {
    size_t size = 0;
    std::vector<float> dx, dy;       // of the grey value
    std::vector<float> weight;       // of the Gaussian
    std::vector<float> column, row;  // in cells, of the descriptor
    std::vector<float> length, angle;

    // Room for so many; none is in use.
    void Reserve(size_t capacity);
    void ComputePolar();
  };
  // Appends those of pixels `begin` to `end` of a row, weighted by the Gaussian
  // exp(factor |pixel - point|^2).
  void AppendRow(const cv::Mat& level, const ScaleSpacePoint& point,
                 float factor, int y, int begin, int end);
  // Of one dimension, for pixels `begin` to `end`.
  void ComputeColumnWeights(float center, float factor, int begin, int end);
  void GatherCells(const cv::Mat& level, const ScaleSpacePoint& point,
                   float orientation_rad);

  Gradients gradients_;
  int first_column_ = 0;
  std::vector<float> column_weights_;
};

}  // namespace mgsfm
