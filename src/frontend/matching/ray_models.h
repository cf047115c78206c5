// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "base/random.h"
#include "geometry/epipolar.h"

namespace mgsfm {

// Two-view models on unit rays other than relative poses. Both are estimated by
// LO-RANSAC with the truncated squared error of EstimateRelativePose as cost,
// and stop at RansacOptions::confidence or max_num_trials. Errors are angles in
// radians. nullopt if no model has more inliers than a sample.

// F of rank 2 with f2^T F f1 = 0, for cameras with unknown intrinsics whose
// rays are linear in the pixel coordinates. The error is the first-order
// (Sampson) distance of both rays to the constraint:
//   r = f2^T F f1 / sqrt(|F f1|^2 + |F^T f2|^2 - 2 (f2^T F f1)^2).
// Samples: seven points (Hartley, Zisserman: Multiple View Geometry, 2004,
// 11.1.2). Local optimization: weighted least squares on the inliers.
std::optional<Eigen::Matrix3d> EstimateFundamental(const RayMatches& matches,
                                                   const RansacOptions& options,
                                                   Random* random);
bool IsFundamentalInlier(const Eigen::Matrix3d& F, const Eigen::Vector3d& ray1,
                         const Eigen::Vector3d& ray2, double max_error_rad);

// H with f2 ~ H f1, of positive scale. The error is the larger of
// |f2 - H f1 / |H f1|| and its counterpart from image 2 to 1. Samples: four
// points, in closed form. Local optimization: weighted least squares on the
// inliers.
std::optional<Eigen::Matrix3d> EstimateHomography(const RayMatches& matches,
                                                  const RansacOptions& options,
                                                  Random* random);

// Symmetric transfer error of a homography; computes the inverse once.
class HomographyTest {
 public:
  explicit HomographyTest(const Eigen::Matrix3d& H);
  double SquaredError(const Eigen::Vector3d& ray1,
                      const Eigen::Vector3d& ray2) const;

 private:
  Eigen::Matrix3d H_;
  Eigen::Matrix3d inverse_;
};

}  // namespace mgsfm
