// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <optional>
#include <vector>

#include "base/random.h"
#include "geometry/epipolar.h"
#include "geometry/ransac.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Generalized resection: the pose of a rigid unit, a set of cameras with known
// poses in the unit, from 2D-3D correspondences.

// The correspondences of one camera of a unit. Both arrays have the same size.
struct CameraPoints {
  Rigid3 cam_from_unit;
  std::vector<Eigen::Vector3d> rays;    // unit length, in the camera frame
  std::vector<Eigen::Vector3d> points;  // in the world
  double max_error_rad = 2e-3;
  // Per point: the displacement by one standard deviation of its depth, in the
  // world. Empty if the points are exact.
  std::vector<Eigen::Vector3d> depth_sigmas = {};

  size_t size() const { return rays.size(); }
};

// Unknown: unit_from_world = (R, t). The error of ray f of point p,
//   r = |y / |y| - f| / max_error,  y = cam_from_unit (R p + t),
// is the angle between ray and point divided by its bound, for small angles. An
// uncertain depth moves the projection of a point by g. The component of r
// along g then has the variance s^2 + |g|^2 instead of s^2 = kKeypointSigma^2,
// and is divided by sqrt(1 + |g|^2 / s^2): far points measure the direction of
// a motion, and near ones its length.

// The standard deviation of r for a keypoint and a point that one other
// keypoint observes: one pixel each for a bound of four.
inline constexpr double kKeypointSigma = 0.35;

// The loss scale relative to the largest error of inliers: it keeps them in the
// quadratic range and downweights those near the bound.
inline constexpr double kInlierLossScale = 0.5;

// Whether r <= 1 for one ray. The point and the displacement by one standard
// deviation of its depth are in the camera frame.
bool IsRayInlier(const Eigen::Vector3d& point,
                 const Eigen::Vector3d& depth_sigma, const Eigen::Vector3d& ray,
                 double max_error_rad);

// The truncated cost sum min(r^2, 1) over all rays. Inliers have r <= 1. Stops
// early if the cost reaches max_cost: the pose is then worse than the best.
PoseScore ScoreAbsolutePose(
    const std::vector<CameraPoints>& cameras, const Rigid3& unit_from_world,
    double max_cost = std::numeric_limits<double>::infinity());

// The errors r of all rays, in the order of the cameras.
std::vector<double> AbsolutePoseErrors(const std::vector<CameraPoints>& cameras,
                                       const Rigid3& unit_from_world);

// Minimizes sum_i c^2 / 2 log(1 + r_i^2 / c^2), c = loss_scale, by
// Levenberg-Marquardt; a step is R <- Exp(delta[0:3]) R, t <- t + delta[3:6].
// Stops when the relative decrease of the cost is at most 1e-8, or after 20
// iterations. kFailure for fewer than 3 rays. Cost: one pass over the rays per
// iteration.
SolveSummary RefineAbsolutePose(const std::vector<CameraPoints>& cameras,
                                double loss_scale, Rigid3* unit_from_world);

// Covariance of this step for rays whose errors have standard deviation
// loss_scale.
PoseMatrix AbsolutePoseCovariance(const std::vector<CameraPoints>& cameras,
                                  double loss_scale,
                                  const Rigid3& unit_from_world);

// The same with few iterations, as the start of another refinement.
SolveSummary ImproveAbsolutePose(const std::vector<CameraPoints>& cameras,
                                 double loss_scale, Rigid3* unit_from_world);

// All solutions cam_from_world of the perspective three-point problem. The
// depths along the rays solve a quartic (Grunert 1841, in Haralick et al.,
// Review and analysis of solutions of the three point perspective pose
// estimation problem, IJCV 1994) and are polished by Newton steps on the
// distances between the points. Returns the number of solutions, up to 4; 0 for
// collinear points and other degenerate samples.
int SolveP3P(const std::array<Eigen::Vector3d, 3>& rays,
             const std::array<Eigen::Vector3d, 3>& points,
             std::array<Rigid3, 4>* cam_from_world);

// LO-RANSAC on samples of three rays of one camera; cameras are drawn with
// probability proportional to their number of rays. Poses are scored over the
// rays of all cameras, and each new best pose is refined on its inliers. The
// number of trials adapts to the inlier ratio. The final refinement uses twice
// the median inlier error as loss scale. max_error_rad of the options is
// ignored. nullopt if no camera has three rays or all samples are degenerate.
std::optional<Rigid3> EstimateAbsolutePose(
    const std::vector<CameraPoints>& cameras, const RansacOptions& options,
    Random* random);

}  // namespace mgsfm
