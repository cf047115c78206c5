// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "pair_filtering/skeleton_consistency.h"
#include "translation_averaging/baseline_directions.h"
#include "translation_averaging/position_problem.h"

namespace mgsfm {

// The length of the baseline of one pair in the unit of its group.
struct PairScale {
  double scale = 0.0;
  double sigma_log = 0.0;  // standard deviation of log(scale)
  int group = 0;
};

// Relative lengths of the baselines of pairs. All pairs of a group share one
// unknown factor. The factors are chosen such that all groups have the same
// median point depth. This is a guess, because nothing links two groups.
struct PairScales {
  // Per pair; nullopt unless the pair is kDirection.
  std::vector<std::optional<PairScale>> pairs;
  // Number of pairs in each group, in descending order.
  std::vector<int> group_sizes;
  // Median depth of points in the unit of `scale`; 0 if no pair is kDirection.
  double typical_depth = 0.0;
};

// Knowledge of baseline lengths other than from depths of their matches.
struct LengthHints {
  // Sets of pairs with equal baselines: two cameras of a rig have the same one
  // in all frames.
  std::vector<std::vector<int>> equal_pairs = {};
  // Per pair, in one unknown unit; empty if none is expected.
  std::vector<std::optional<double>> expected = {};
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
// with a Cauchy loss rho, by reweighted least squares from a maximum spanning
// forest. Stops when no log s changes by more than 1e-4, or after 20 rounds.
// Gauge: one factor per group; the unit is the median of `scale` in group 0.
// Hints add links: between the pairs of each set of equal lengths, and from
// each expected length to its unit. Links from expected lengths are weak; they
// decide where matches do not link pairs. Cost: O(sum over images of (pairs of
// the image)^2 * matches) for the edges, in parallel, and 20 sparse
// factorizations of a matrix with one row per pair.
PairScales AverageScales(const std::vector<BaselineDirection>& baselines,
                         int num_images, const Context& context,
                         const LengthHints& hints = {});

// The inputs of baseline consistency (pair_filtering/skeleton_consistency.h),
// computed from translation averaging.

// Per direction: the baseline scale * group_factor * direction. Pairs in the
// largest scale group are comparable.
MeasuredBaselines MeasureBaselines(
    const std::vector<BaselineDirection>& directions, const PairScales& scales,
    const std::vector<double>& group_factor);

// Per image.
CameraCenters ComputeCameraCenters(const PositionProblem& problem,
                                   const Positions& positions);

// Baselines and centers in the unit of `group_factor`.
BaselineComparison CompareWith(const PositionProblem& problem,
                               const std::vector<BaselineDirection>& directions,
                               const PairScales& scales,
                               const std::vector<double>& group_factor,
                               const Positions& positions);

}  // namespace mgsfm
