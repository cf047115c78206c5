// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "geometry/epipolar.h"
#include "geometry/ransac.h"
#include "mgsfm/base/random.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Resection: the pose of a rigid unit, a set of cameras at known places in it,
// from known points that its cameras see. One camera is a unit of one.

// What one camera of a unit sees; both arrays are equally long.
struct CameraPoints {
  Rigid3 cam_from_unit;
  std::vector<Eigen::Vector3d> rays;    // unit, in the camera
  std::vector<Eigen::Vector3d> points;  // in the world
  double max_error_rad = 2e-3;

  size_t size() const { return rays.size(); }
};

// Unknown: unit_from_world = (R, t). The error of ray f of point p,
//   r = |y / |y| - f| / max_error,  y = cam_from_unit (R p + t),
// is the angle between them over its bound where that is small.

// The sum over all rays of min(r^2, 1); inliers have r <= 1.
PoseScore ScoreAbsolutePose(const std::vector<CameraPoints>& cameras,
                            const Rigid3& unit_from_world);

// r of all rays, camera by camera.
std::vector<double> AbsolutePoseErrors(const std::vector<CameraPoints>& cameras,
                                       const Rigid3& unit_from_world);

// Minimises sum_i c^2 / 2 log(1 + r_i^2 / c^2), c = loss_scale, by
// Levenberg-Marquardt; a step is R <- Exp(delta[0:3]) R, t <- t + delta[3:6].
// Stops when the cost falls by at most 1e-8 of itself, or after 20 iterations.
// kFailure with fewer than 3 rays. Cost per iteration: one pass over the rays.
SolveSummary RefineAbsolutePose(const std::vector<CameraPoints>& cameras,
                                double loss_scale, Rigid3* unit_from_world);

// All cam_from_world that three rays with their points allow: the lengths along
// the rays are the intersections of two conics, a quartic (Grunert, 1841, as in
// Haralick et al., Review and analysis of solutions of the three point
// perspective pose estimation problem, IJCV 1994), made exact by Newton steps
// on the distances between the points. Returns their number, up to 4; 0 for
// points on a line and other degenerate samples.
int SolveP3P(const std::array<Eigen::Vector3d, 3>& rays,
             const std::array<Eigen::Vector3d, 3>& points,
             std::array<Rigid3, 4>* cam_from_world);

// LO-RANSAC: samples of three rays of one camera, drawn with the numbers of
// rays as weights; each pose is scored over the rays of all cameras, and every
// new best one is refined on its inliers. As many trials as the inliers found
// so far ask for. In the end it is refined once more, with twice the median
// error of the inliers as loss scale. max_error_rad of the options has no
// effect. nullopt if no camera has three rays or every sample was degenerate.
std::optional<Rigid3> EstimateAbsolutePose(
    const std::vector<CameraPoints>& cameras, const RansacOptions& options,
    Random* random);

}  // namespace mgsfm
