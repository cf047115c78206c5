// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/base/random.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct TwoViewGeometryOptions {
  int min_num_inliers = 15;
  double min_inlier_ratio = 0.25;
  double max_error = 4.0;
  double confidence = 0.999;
  int max_num_trials = 10000;
  // As COLMAP spells it. NOLINTNEXTLINE(readability-identifier-naming)
  double max_H_inlier_ratio = 0.8;
  bool detect_watermark = true;
  double watermark_border_size = 0.1;
  double watermark_min_inlier_ratio = 0.7;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("min_num_inliers", self.min_num_inliers, AtLeast(8), "matches",
          "Pairs with fewer matches that agree are given up.");
    visit("min_inlier_ratio", self.min_inlier_ratio, Between(0.0, 1.0), "",
          "Pairs with a smaller share of such matches are given up.");
    visit("max_error", self.max_error, GreaterThan(0.0), "px",
          "Largest distance to the epipolar line or homography.");
    visit("confidence", self.confidence, Between(0.0, 0.999999), "",
          "That one sample was drawn without wrong matches.");
    visit("max_num_trials", self.max_num_trials, AtLeast(1), "trials",
          "Most samples of a pair.");
    visit("max_H_inlier_ratio", self.max_H_inlier_ratio, Between(0.0, 1.0), "",
          "Pairs of which a homography explains a larger share of the "
          "inliers are planar or panoramic.");
    visit("detect_watermark", self.detect_watermark, AnyValue(), "",
          "Mark pairs whose inliers are a shifted frame around the image.");
    visit("watermark_border_size", self.watermark_border_size,
          Between(0.0, 0.5), "of the diagonal", "Width of that frame.");
    visit("watermark_min_inlier_ratio", self.watermark_min_inlier_ratio,
          Between(0.0, 1.0), "",
          "Least share of inliers that are in the frame, and shifted alike.");
  }
};

// The parts of an image that verification reads. Refers to data that must
// outlive it.
struct VerificationView {
  const Camera* camera = nullptr;
  const std::vector<Eigen::Vector2f>* keypoints_px = nullptr;
  const KeypointRays* rays = nullptr;
};

// The two-view geometry that explains the most matches, and which those are.
//
// Trusted intrinsics (a prior focal length of both cameras; always for cameras
// that are no pinholes with some distortion): errors are angles between rays,
// so that views may be wider than 180 degrees. A rotation (samples of 2), a
// relative pose (five-point, points in front of both cameras), and on the
// inliers a homography of rays (4) are estimated by LO-RANSAC. max_error px are
// as many radians as by the mean of both cameras' pixels per radian.
// Otherwise: F (7) and H (4) in pixels, without regard to distortion.
//
// With n_X the inliers of model X, r = max_H_inlier_ratio:
//   CALIBRATED           n_H <= r n_E
//   PLANAR               n_H > r n_E
//   PANORAMIC            so, and the rotation alone explains 0.95 n_H; no
//                        direction of translation is given
//   UNCALIBRATED         n_H <= r n_F
//   PLANAR_OR_PANORAMIC  n_H > r n_F
//   WATERMARK            see the options
//   DEGENERATE           too few inliers; there are no matches in the result
// E and the pose are given with intrinsics, F and H (in pixels) where both
// images are free of distortion, or taken to be so.
//
// The most samples drawn are those that find the smallest acceptable share of
// inliers with the wanted confidence. Image positions are not set.
ImagePair VerifyPair(const VerificationView& view1,
                     const VerificationView& view2,
                     const std::vector<Match>& matches,
                     const TwoViewGeometryOptions& options, Random random);

// A seed for a pair that depends on names only, not on ids or order of work.
uint64_t PairSeed(const std::string& image_name1,
                  const std::string& image_name2, uint64_t random_seed);

}  // namespace mgsfm
