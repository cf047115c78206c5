// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "base/random.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// One image of a pair to verify. Refers to data that must outlive it. `rays`
// holds the unit viewing ray of each keypoint in the camera frame; nullopt if
// the camera model cannot unproject the keypoint.
struct VerificationView {
  const Camera* camera = nullptr;
  const std::vector<Eigen::Vector2f>* keypoints_px = nullptr;
  const std::vector<std::optional<Eigen::Vector3d>>* rays = nullptr;
};

// Calibration matrix of a perspective camera without its distortion; identity
// for other models.
Eigen::Matrix3d LinearPart(const Camera& camera);
// The unit ray of a keypoint by the inverse of this matrix.
Eigen::Vector3d LinearRay(const Eigen::Matrix3d& inverse_K,
                          const Eigen::Vector2f& keypoint_px);

// The mean angle of a pixel over both cameras, at their principal points.
double RadiansPerPixel(const Camera& camera1, const Camera& camera2);

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
// RANSAC draws at most as many samples as needed to find a model of the
// smallest acceptable inlier ratio with the requested confidence, and stops
// earlier if the best model has a larger ratio. image_idx1 and image_idx2 of
// the result are not set.
[[nodiscard]] ImagePair VerifyPair(const VerificationView& view1,
                                   const VerificationView& view2,
                                   const std::vector<Match>& matches,
                                   const TwoViewGeometryOptions& options,
                                   Random random);

// Whether the inliers of a two-view geometry belong to a watermark, i.e. a
// frame or caption inserted into both images: at least
// watermark_min_inlier_ratio of them lie at the border of both images and share
// one translation, up to max_error.
bool IsWatermark(const VerificationView& view1, const VerificationView& view2,
                 const std::vector<Match>& inliers,
                 const TwoViewGeometryOptions& options, Random* random);

}  // namespace mgsfm
