// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// Triangulation of a point p from two or more rays. Ray k starts at centers[k]
// and has the unit direction rays[k], in a common frame. All functions use the
// mean of the centers as origin and relative stopping criteria, so the results
// are equivariant to translation and scale.

// The point nearest to all lines, min_p sum_k |rays[k] x (p - centers[k])|^2.
// nullopt for fewer than two lines or lines that are parallel within 1e-6 rad.
std::optional<Eigen::Vector3d> TriangulateMidpoint(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& rays);

// The same for two rays in closed form. nullopt also if the point is behind one
// of the cameras.
std::optional<Eigen::Vector3d> TriangulateTwoRays(
    const Eigen::Vector3d& center1, const Eigen::Vector3d& ray1,
    const Eigen::Vector3d& center2, const Eigen::Vector3d& ray2);

// L1 triangulation, robust to a minority of wrong rays: the p with
//   p = argmin_x sum_k |rays[k] x (x - centers[k])| / d_k,
// where d_k = |p - centers[k]|. This is eq. (17) of MGSfM with two changes: the
// norm of each 3-vector replaces the sum over its components, which makes the
// result independent of the axes, and distances are divided by depths, so that
// distant rays do not dominate. Solved by iteratively reweighted least squares
// until |step| <= 1e-8 |p - mean(centers)|, at most 50 iterations. nullopt if
// the lines are parallel or the point is behind at least half of the cameras.
std::optional<Eigen::Vector3d> TriangulateL1(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& rays);

struct RobustTriangulationOptions {
  // Maximum angle between an inlier ray and the direction to the point. Points
  // behind the camera are never within it.
  double max_error_rad = 0.01;
  // Minimum angle between the most distant pair of inlier rays.
  double min_angle_rad = 0.0;
};

struct RobustTriangulation {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  Mask is_inlier;  // per ray
  int num_inliers = 0;
};

// Minimizes sum_k min(error_k, max_error)^2 over the points of pairs of rays
// (all pairs, or a deterministic subset of 60), then refines the best point by
// least squares on the angles of its inliers. nullopt for fewer than two
// inliers or too small an angle between them.
std::optional<RobustTriangulation> TriangulateRobust(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& rays,
    const RobustTriangulationOptions& options);

// Angle between a ray and the direction to the point, in [0, pi]. pi if the
// point coincides with the center.
double AngularError(const Eigen::Vector3d& center, const Eigen::Vector3d& ray,
                    const Eigen::Vector3d& point);

// The largest angle at the point between the directions to two centers. The
// search stops at the first angle of at least enough_rad.
double MaxTriangulationAngle(const std::vector<Eigen::Vector3d>& centers,
                             const Eigen::Vector3d& point,
                             double enough_rad = kPi);

}  // namespace mgsfm
