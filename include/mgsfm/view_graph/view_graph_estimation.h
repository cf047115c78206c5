// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct ViewGraphOptions {
  int min_num_inliers = 15;
  double min_inlier_ratio = 0.25;
  double max_error_px = 2.0;
  double loss_scale = 1.0;
  double min_row_inlier_ratio = 0.5;
  double min_parallax_px = 2.0;
  double min_parallax_ratio = 0.05;
  int max_num_trials = 2000;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("min_num_inliers", self.min_num_inliers, AtLeast(5), "matches",
          "Pairs with fewer matches that agree with their relative pose are "
          "dropped.");
    visit("min_inlier_ratio", self.min_inlier_ratio, Between(0.0, 1.0), "",
          "Pairs with a smaller share of such matches are dropped.");
    visit("max_error_px", self.max_error_px, GreaterThan(0.0), "px",
          "Matches farther from their epipolar geometry are dropped.");
    visit("loss_scale", self.loss_scale, GreaterThan(0.0), "median errors",
          "Errors beyond this times the median error of the pair count less "
          "and less in its relative pose (scale of the Cauchy loss).");
    visit("min_row_inlier_ratio", self.min_row_inlier_ratio, Between(0.0, 1.0),
          "",
          "The geometry given with a pair is used if at least this share of "
          "its matches agrees; otherwise it is estimated anew.");
    visit("min_parallax_px", self.min_parallax_px, AtLeast(0.0), "px",
          "Matches that a rotation alone explains to within this have no "
          "parallax.");
    visit("min_parallax_ratio", self.min_parallax_ratio, Between(0.0, 1.0), "",
          "Pairs with a smaller share of matches with parallax only get a "
          "relative rotation, no direction of translation.");
    visit("max_num_trials", self.max_num_trials, AtLeast(1), "trials",
          "Most samples to draw where a pair is estimated anew.");
  }
};

struct ViewGraphSummary {
  int num_pairs = 0;         // given
  int num_from_row = 0;      // kept, started at the relative pose of the row
  int num_decomposed = 0;    // kept, started at E, F or H of the row
  int num_reestimated = 0;   // kept, no usable geometry in the row
  int num_low_parallax = 0;  // kept, of all three, without direction
  int num_dropped_few_inliers = 0;
  int num_dropped_config = 0;  // DEGENERATE or WATERMARK
  size_t num_matches = 0;      // of the given pairs
  size_t num_inliers = 0;      // of the kept pairs
};

struct ViewGraphResult {
  // The kept pairs: relative_pose is set, F, E and H are not, matches are
  // inliers.
  ViewGraph estimate;
  ViewGraphSummary summary;
};

// Estimates the relative pose of every pair by itself, without any knowledge of
// rigs. For each pair:
//  1. Start: of the row's relative pose and the decompositions of its E, F and
//     H (these two for cameras without distortion), the one with the least
//     truncated Sampson error over all matches, points in front of both
//     cameras. If too few matches agree: LO-RANSAC of a rotation and of a pose.
//  2. Refinement of the 5 degrees of freedom, Cauchy loss on Sampson angles of
//     rays (mgsfm/geometry/epipolar.h).
//     The scale of the loss follows the median error of the pair.
//  3. Parallax: a rotation is fitted alone. If it explains nearly all inliers,
//     the direction of translation is meaningless and is left out. The pair
//     keeps that rotation if its errors are those of noise, and else the one of
//     the pose, which the parallax does not bias.
// Pixel thresholds become angles by the mean of both cameras' pixels per
// radian. Pairs are independent and run in parallel; linear in the number of
// matches.
[[nodiscard]] ViewGraphResult EstimateViewGraph(const Scene& scene,
                                                const Bearings& bearings,
                                                const ViewGraph& view_graph,
                                                const ViewGraphOptions& options,
                                                const Context& context);

}  // namespace mgsfm
