// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

namespace mgsfm {

// The `config` of a two-view geometry, with the values of COLMAP.
enum class TwoViewConfig : int {
  kUndefined = 0,
  kDegenerate = 1,
  kCalibrated = 2,
  kUncalibrated = 3,
  kPlanar = 4,
  kPanoramic = 5,
  kPlanarOrPanoramic = 6,
  kWatermark = 7,
  kMultiple = 8,
  kCalibratedRig = 9,
};

// A matched pair of keypoints in images 1 and 2 of an ImagePair.
struct Match {
  uint32_t keypoint_idx1;
  uint32_t keypoint_idx2;
};

// cam2_from_cam1 up to the length of the translation. The direction is nullopt
// if the parallax of the pair is too small to determine it.
struct RelativePose {
  Eigen::Quaterniond cam2_from_cam1;
  std::optional<Eigen::Vector3d> translation_direction;  // unit, in camera 2
};

// A pair of images with verified matches, image_idx1 < image_idx2. F, E and H
// map image 1 to image 2: x2^T F x1 = 0 and x2 ~ H x1 in pixels, r2^T E r1 = 0
// for rays. Verification finds one motion per pair; correct matches can be
// among its outliers if something else moves in the images.
struct ImagePair {
  int image_idx1 = 0;
  int image_idx2 = 0;
  TwoViewConfig config = TwoViewConfig::kUndefined;
  std::optional<Eigen::Matrix3d> F, E, H;
  std::optional<RelativePose> relative_pose;
  std::vector<Match> matches;
  std::vector<Match> outliers = {};  // the other matches, if they are known
};

// The matches before verification.
[[nodiscard]] std::vector<Match> AllMatches(const ImagePair& pair);

// The matches of keypoints that no inlier has: a keypoint has one match.
[[nodiscard]] std::vector<Match> OutliersOf(
    const std::vector<Match>& all_matches, const std::vector<Match>& inliers);

// Pairs sorted by (image_idx1, image_idx2), each at most once.
struct ViewGraph {
  std::vector<ImagePair> pairs;
};

// nullptr if the view graph does not have the pair.
const ImagePair* FindPair(const ViewGraph& view_graph, int image_idx1,
                          int image_idx2);

}  // namespace mgsfm
