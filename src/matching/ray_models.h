// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "geometry/epipolar.h"
#include "mgsfm/base/random.h"

namespace mgsfm::internal {

// Two-view models on unit rays that are not poses, by LO-RANSAC as
// EstimateRelativePose. Errors are angles in radians.

// f2^T F f1 = 0 with F of rank 2, for cameras with unknown intrinsics whose
// rays are linear in pixels. First-order distance of both rays to the
// constraint, as SampsonAngle:
//   r = f2^T F f1 / sqrt(|F f1|^2 + |F^T f2|^2 - 2 (f2^T F f1)^2).
// Seven-point samples (Hartley, Zisserman: Multiple View Geometry, 2004,
// 11.1.2); locally, weighted least squares on the inliers.
std::optional<Eigen::Matrix3d> EstimateFundamental(const RayMatches& matches,
                                                   const RansacOptions& options,
                                                   Random* random);
bool IsFundamentalInlier(const Eigen::Matrix3d& F, const Eigen::Vector3d& ray1,
                         const Eigen::Vector3d& ray2, double max_error_rad);

// f2 ~ H f1 with positive scale. r is the larger of |f2 - H f1 / |H f1|| and
// the same from 2 to 1. Samples of four, in closed form; locally, weighted
// least squares on the inliers.
std::optional<Eigen::Matrix3d> EstimateHomography(const RayMatches& matches,
                                                  const RansacOptions& options,
                                                  Random* random);

// A homography with its inverse, as tests of many matches need it.
class HomographyTest {
 public:
  explicit HomographyTest(const Eigen::Matrix3d& H);
  double SquaredError(const Eigen::Vector3d& ray1,
                      const Eigen::Vector3d& ray2) const;

 private:
  Eigen::Matrix3d H_;
  Eigen::Matrix3d inverse_;
};

}  // namespace mgsfm::internal
