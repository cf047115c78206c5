// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct ViewGraphOptions {
  Option<int> min_num_inliers{"min_num_inliers", 15, AtLeast(5), "matches",
                              "Reject image pairs with fewer inliers."};
  // Minimum inlier ratio of an image pair.
  double min_inlier_ratio = 0.25;
  Option<double> max_error_px{
      "max_error_px", 2.0, GreaterThan(0.0), "px",
      "Count matches with at most this epipolar error as inliers. Increase it "
      "for images of very high resolution."};
  // Scale of the Cauchy loss on epipolar errors, as a multiple of the median
  // error of the pair.
  double loss_scale = 1.0;
  // Minimum inlier ratio of the two-view geometry in the database to initialize
  // the relative pose; otherwise it is re-estimated.
  double min_row_inlier_ratio = 0.5;
  // Minimum error of a match to a pure rotation that counts as parallax.
  double min_parallax_px = 2.0;
  // Minimum ratio of inliers with parallax; pairs with a smaller one get a
  // relative rotation without translation direction.
  double min_parallax_ratio = 0.05;
  // Maximum number of RANSAC trials per re-estimated pair.
  int max_num_trials = 2000;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(min_num_inliers, max_error_px);
  }
};

struct ViewGraphSummary {
  int num_pairs = 0;         // input pairs
  int num_from_row = 0;      // kept, initialized by the input relative pose
  int num_decomposed = 0;    // kept, initialized by the input E, F or H
  int num_reestimated = 0;   // kept, initialized by RANSAC
  int num_low_parallax = 0;  // kept without translation direction
  int num_dropped_few_inliers = 0;
  int num_dropped_config = 0;  // DEGENERATE or WATERMARK
  size_t num_matches = 0;      // of all input pairs
  size_t num_inliers = 0;      // of the kept pairs

  // Adds a second verification of pairs that the first one dropped.
  void AddSecond(const ViewGraphSummary& second);

  auto Fields() const {
    return Named("num_pairs", num_pairs, "num_matches", num_matches,
                 "num_inliers", num_inliers, "kept",
                 Named("pose_from_row", num_from_row, "pose_from_E_F_or_H",
                       num_decomposed, "pose_estimated_anew", num_reestimated,
                       "of_these_without_parallax", num_low_parallax),
                 "dropped",
                 Named("too_few_inliers", num_dropped_few_inliers,
                       "degenerate_or_watermark", num_dropped_config));
  }
};

struct ViewGraphResult {
  // The kept pairs, with relative_pose and without F, E and H. Their matches
  // are the inliers.
  ViewGraph estimate;
  ViewGraphSummary summary;
};

// Estimates the relative pose (5 degrees of freedom) of each image pair; rigs
// are not used. For each pair:
//  1. Initialization: of the input relative pose and the decompositions of E, F
//     and H (the latter two for cameras without distortion), the pose with the
//     smallest truncated squared Sampson error over all matches, with points in
//     front of both cameras. If it has too few inliers, LO-RANSAC of a rotation
//     and of a pose.
//  2. Refinement: Levenberg-Marquardt on the Cauchy loss of Sampson angles
//     (geometry/epipolar.h), first with a fixed scale, then with one
//     proportional to the median error of the pair. It stops at a relative cost
//     decrease of 1e-5 or after 15 iterations.
//  3. Planes: if most inliers lie on a plane, the other motion that explains it
//     is refined as well. If both explain almost all matches, triangles of
//     images decide between them (docs/maths/view_graph.md).
//  4. Parallax: a pure rotation is fitted as well. If it explains almost all
//     inliers, the translation direction is unreliable and not set. The pair
//     keeps the pure rotation if its errors are at noise level; otherwise the
//     rotation of the pose, which parallax does not bias.
// Pixel thresholds are converted to angles by the mean of both cameras' pixels
// per radian. Cost: linear in the number of matches; pairs run in parallel.
[[nodiscard]] ViewGraphResult EstimateViewGraph(const Scene& scene,
                                                const Bearings& bearings,
                                                const ViewGraph& view_graph,
                                                const ViewGraphOptions& options,
                                                const Context& context);

}  // namespace mgsfm
