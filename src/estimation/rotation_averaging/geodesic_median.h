// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "mgsfm/base/solver.h"

namespace mgsfm {

struct GeodesicMedian {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  double median_deviation_rad = 0.0;  // of the samples from `rotation`
  SolveSummary summary;
};

// The weighted L1 mean of rotations on SO(3),
//
//   argmin_R  sum_i w_i d(R, R_i),   d the geodesic distance,
//
// by Weiszfeld's algorithm (Hartley, Aftab, Trumpf, CVPR 2011), with the step
// of Vardi and Zhang (2000) at samples: with v_i = Log(R^T R_i), D = sum w_i /
// |v_i|, r = sum w_i v_i / |v_i| over the samples distinct from R and eta = sum
// w_i over samples equal to R,
//
//   R <- R Exp(max(0, 1 - eta / |r|) r / D).
//
// Starts at the sample, of up to 100 evenly spaced ones, with the smallest
// weighted sum of distances, each truncated at `truncation_rad`. It is an
// inlier as long as the outliers agree with each other less than the inliers.
// Stops when the step is at most 1e-10 rad (converged) or after 500 iterations.
// The cost in the summary is the objective. Cost: O(n) for each iteration.
//
// Samples must not be empty; weights must be positive.
GeodesicMedian FindGeodesicMedian(
    const std::vector<Eigen::Quaterniond>& samples,
    const std::vector<double>& weights, double truncation_rad);

}  // namespace mgsfm
