// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "translation/relative_translation.h"

namespace mgsfm {

// Relative lengths of the baselines of pairs. Within one group they share one
// unknown factor. Where nothing links two groups, their factors are chosen such
// that the median depth of points is the same, which is only a guess.
struct PairScales {
  std::vector<double> scale;      // per motion; 0 unless kDirection
  std::vector<double> sigma_log;  // standard deviation of log(scale)
  std::vector<int> group;         // per motion; -1 unless kDirection
  // Number of motions in each group; 0 is the largest.
  std::vector<int> group_sizes;
  // Median depth of points in the unit of `scale`; 0 without any kDirection.
  double typical_depth = 0.0;
};

// Two pairs (i, j) and (i, k) that share image i give, for each keypoint of i
// that both match, the same depth in two units, hence
//
//   log s_ik - log s_ij = log depth_ij - log depth_ik.
//
// The medians over the keypoints, as edges between pairs, are averaged:
//
//   min_s sum_e rho((log s_b - log s_a - ratio_e)^2 / sigma_e^2)
//
// with a Cauchy loss from a maximum spanning forest, by reweighted least
// squares; ends when no log s changes by more than 1e-4, or after 20 rounds.
// Lengths on collinear motion and of cameras without overlap follow from it,
// which directions alone do not give. Unit: the median of scale in group 0.
// Cost: O(sum over images of (pairs of the image)^2 * matches) for the edges,
// in parallel, and 20 sparse factorisations of a matrix of one row a pair.
PairScales AverageScales(const std::vector<BaselineDirection>& motions,
                         int num_images, const Context& context);

}  // namespace mgsfm
