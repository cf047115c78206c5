// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/base/random.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Names are COLMAP's.
struct TwoViewGeometryOptions {
  Option<int> min_num_inliers{
      "min_num_inliers", 15, AtLeast(8), "matches",
      "Minimum number of inliers of a verified image pair."};
  Option<double> min_inlier_ratio{
      "min_inlier_ratio", 0.25, Between(0.0, 1.0),
      "Minimum inlier ratio of a verified image pair."};
  Option<double> max_error{
      "max_error", 4.0, GreaterThan(0.0), "px",
      "Maximum epipolar or homography transfer error of an inlier. Increase it "
      "for images of very high resolution."};
  Option<double> confidence{
      "confidence", 0.999, Between(0.0, 0.999999),
      "Confidence of RANSAC: probability that at least one sample is free of "
      "outliers."};
  Option<int> max_num_trials{"max_num_trials", 10000, AtLeast(1), "trials",
                             "Maximum number of RANSAC trials per image pair."};
  // COLMAP's spelling. NOLINTNEXTLINE(readability-identifier-naming)
  Option<double> max_H_inlier_ratio{
      "max_H_inlier_ratio", 0.8, Between(0.0, 1.0),
      "An image pair is planar or panoramic if the ratio of homography inliers "
      "to inliers exceeds this value."};
  Option<bool> detect_watermark{
      "detect_watermark", true,
      "Detect pairs whose inliers are a watermark, that is, a translated "
      "pattern at the image border."};
  Option<double> watermark_border_size{
      "watermark_border_size", 0.1, Between(0.0, 0.5), "of the diagonal",
      "Width of the border in which watermarks are searched."};
  Option<double> watermark_min_inlier_ratio{
      "watermark_min_inlier_ratio", 0.7, Between(0.0, 1.0),
      "Minimum ratio of inliers in the border that share one translation for a "
      "pair to be a watermark."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(min_num_inliers, min_inlier_ratio, max_error, confidence,
          max_num_trials, max_H_inlier_ratio, detect_watermark,
          watermark_border_size, watermark_min_inlier_ratio);
  }
};

// One image of a pair to verify. Refers to data that must outlive it. `rays`
// holds the unit viewing ray of each keypoint in the camera frame; nullopt if
// the camera model cannot unproject the keypoint.
struct VerificationView {
  const Camera* camera = nullptr;
  const std::vector<Eigen::Vector2f>* keypoints_px = nullptr;
  const std::vector<std::optional<Eigen::Vector3d>>* rays = nullptr;
};

// Estimates the two-view geometry with the largest consensus and its inliers.
//
// Calibrated path, if both cameras have a prior focal length or either model is
// not a perspective one: errors are angles between rays, so that fields of view
// above 180 degrees are allowed. LO-RANSAC estimates a relative pose
// (five-point samples, points in front of both cameras), a rotation (samples of
// 2) and, on the inliers, a homography of rays (samples of 4). max_error is
// converted to radians by the mean of both cameras' pixels per radian.
// Uncalibrated path, otherwise: F (7) and H (4) in pixels; distortion is
// neglected.
//
// With n_X the number of inliers of model X and r = max_H_inlier_ratio:
//   CALIBRATED           n_H <= r n_E
//   PLANAR               n_H > r n_E
//   PANORAMIC            n_H > r n_E and the rotation explains at least
//                        0.95 n_H; there is no translation direction
//   UNCALIBRATED         n_H <= r n_F
//   PLANAR_OR_PANORAMIC  n_H > r n_F
//   WATERMARK            see the options
//   DEGENERATE           too few inliers; the result has no matches
// E and the relative pose are set on the calibrated path. F and H (in pixels)
// are set if both cameras are pinholes or on the uncalibrated path.
//
// RANSAC draws at most as many samples as find a model of the smallest
// acceptable inlier ratio with the requested confidence, and stops earlier if
// the best model has a larger one. image_idx1 and image_idx2 of the result are
// not set.
[[nodiscard]] ImagePair VerifyPair(const VerificationView& view1,
                                   const VerificationView& view2,
                                   const std::vector<Match>& matches,
                                   const TwoViewGeometryOptions& options,
                                   Random random);

}  // namespace mgsfm
