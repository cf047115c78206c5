// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/io/database/feature_database.h"

namespace mgsfm {

// Rows from top to bottom.
using GrayImage =
    Eigen::Matrix<uint8_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct SiftOptions {
  int max_image_size = 3200;
  int max_num_features = 8192;
  int num_octaves = 4;
  int octave_resolution = 3;
  double peak_threshold = 0.02 / 3.0;
  double edge_threshold = 10.0;
  int max_num_orientations = 2;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("max_image_size", self.max_image_size, AtLeast(16), "px",
          "Larger images are scaled down to this width or height. Keypoints "
          "are in pixels of the original.");
    visit("max_num_features", self.max_num_features, AtLeast(1), "features",
          "At most so many of an image, those of the largest scales.");
    visit("num_octaves", self.num_octaves, Between(1, 16), "octaves",
          "The first is that of the image at twice its size.");
    visit("octave_resolution", self.octave_resolution, Between(1, 10), "levels",
          "Scales in each octave.");
    visit("peak_threshold", self.peak_threshold, GreaterThan(0.0), "",
          "Least contrast (difference of Gaussians; grey values are 0 to 1).");
    visit("edge_threshold", self.edge_threshold, GreaterThan(1.0), "",
          "Largest ratio of the principal curvatures.");
    visit("max_num_orientations", self.max_num_orientations, Between(1, 4), "",
          "Features with different orientations at one place.");
  }
};

// Keypoints and the descriptor of each.
struct Features {
  std::vector<FeatureKeypoint> keypoints;
  DescriptorMatrix descriptors{0, 128};
};

// SIFT (Lowe, Distinctive image features from scale-invariant keypoints, IJCV
// 2004) with the conventions of COLMAP: the centre of the first pixel is
// (0.5, 0.5); the first octave is the image at twice its size; the scale of a
// keypoint is the sigma of its level; descriptors are L1-root normalised
// (Arandjelovic, Zisserman, Three things everyone should know to improve object
// retrieval, CVPR 2012), v_i = min(255, round(512 sqrt(d_i / |d|_1))), in the
// order of Lowe's, which is COLMAP's, too.
//
// Written anew rather than taken from OpenCV, whose pyramid shifts keypoints by
// a quarter of a pixel and halves images of odd size inexactly; a rotated
// copy of an image then shows them half a pixel off. Filters are OpenCV's.
//
// Features are sorted by descending scale. Runs in the calling thread. Takes up
// to 200 bytes of memory per pixel.
Features ExtractSift(const GrayImage& image, const SiftOptions& options);

}  // namespace mgsfm
