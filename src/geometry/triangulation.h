// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// A point p from rays: ray k starts at centers[k] and has the unit direction
// rays[k], both in one common frame. All functions compute with the mean of
// the centres as origin and have only relative stopping rules, so results move
// and scale with the input. At least two rays are needed.

// The point nearest to all lines, min_p sum_k |rays[k] x (p - centers[k])|^2.
// nullopt if the lines are parallel (within 1e-6 rad) or fewer than two.
std::optional<Eigen::Vector3d> TriangulateMidpoint(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& rays);

// The same for two rays only, in closed form. nullopt also where the point is
// behind one of the rays.
std::optional<Eigen::Vector3d> TriangulateTwoRays(
    const Eigen::Vector3d& center1, const Eigen::Vector3d& ray1,
    const Eigen::Vector3d& center2, const Eigen::Vector3d& ray2);

// Robust to a minority of wrong rays: the p with
//   p = argmin_x sum_k |rays[k] x (x - centers[k])| / d_k,
// where d_k = |p - centers[k]|. This is eq. (17) of MGSfM with the norm of each
// 3-vector instead of its three components, hence independent of the axes, and
// with each distance to a ray divided by the depth, hence a sum of angles that
// rays from afar do not dominate. Solved by iteratively reweighted least
// squares; ends when |step| <= 1e-8 |p - mean(centers)|, or after 50
// iterations. nullopt if the lines are parallel or the point is behind at least
// half of the rays.
std::optional<Eigen::Vector3d> TriangulateL1(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& rays);

struct RobustTriangulationOptions {
  // A ray is an inlier if it points to the point within this angle (which
  // includes that the point is in front).
  double max_error_rad = 0.01;
  // Least angle that two inlier rays must span.
  double min_angle_rad = 0.0;
};

struct RobustTriangulation {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  Mask is_inlier;  // per ray
  int num_inliers = 0;
};

// The point with the least sum_k min(error_k, max_error)^2 over the points of
// pairs of rays (all pairs if at most 60, otherwise 60 of them, always the
// same), then refined to the least sum of squared angles of its inliers.
// nullopt with fewer than two inliers or too small an angle between them.
std::optional<RobustTriangulation> TriangulateRobust(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& rays,
    const RobustTriangulationOptions& options);

// Angle between a ray and the direction to the point, in [0, pi]; pi if the
// point is the centre.
double AngularError(const Eigen::Vector3d& center, const Eigen::Vector3d& ray,
                    const Eigen::Vector3d& point);

// Largest angle at the point between two of the directions to the centres.
// Where one of at least enough_rad is found, others are not looked for.
double MaxTriangulationAngle(const std::vector<Eigen::Vector3d>& centers,
                             const Eigen::Vector3d& point,
                             double enough_rad = kPi);

}  // namespace mgsfm
