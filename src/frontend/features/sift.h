// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "mgsfm/database/feature_database.h"
#include "mgsfm/features/feature_extraction.h"

namespace mgsfm {

// Rows from top to bottom.
using GrayImage =
    Eigen::Matrix<uint8_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Keypoints and one descriptor per keypoint.
struct Features {
  std::vector<FeatureKeypoint> keypoints;
  DescriptorMatrix descriptors{0, 128};
};

// SIFT (Lowe: Distinctive image features from scale-invariant keypoints, IJCV
// 2004) with COLMAP's conventions: the center of the first pixel is (0.5, 0.5);
// the first octave is the image at twice its size; the scale of a keypoint is
// the sigma of its level; descriptors are L1-root normalized (Arandjelovic,
// Zisserman: Three things everyone should know to improve object retrieval,
// CVPR 2012), v_i = min(255, round(512 sqrt(d_i / |d|_1))), in Lowe's order of
// elements.
//
// OpenCV's SIFT is not used: its pyramid shifts keypoints by a quarter of a
// pixel and halves images of odd size inexactly, so that keypoints in a rotated
// copy of an image are half a pixel off. The filters are OpenCV's.
//
// Features are sorted by descending scale. Runs in the calling thread and takes
// up to 200 bytes of memory per pixel.
Features ExtractSift(const GrayImage& image, const SiftOptions& options);

}  // namespace mgsfm
