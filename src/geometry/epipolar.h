// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <vector>

#include "geometry/ransac.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/random.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Geometry of two views on unit rays instead of image points, so that no field
// of view is too wide: all errors are angles, and "in front" means a positive
// distance along the ray.
//
// Conventions. cam2_from_cam1 is (R, t): x2 = R x1 + t. Only the direction of t
// can be seen, so |t| = 1 wherever a Rigid3 is a relative pose here. For a
// match (f1, f2) let a = R f1. Then
//   e = f2 . (t x a) = f2^T E f1,  E = [t]_x R,
// is the volume spanned by both rays and the baseline: 0 when they meet.

// Unit rays of the same points in two cameras; both arrays are equally long.
struct RayMatches {
  std::vector<Eigen::Vector3d> rays1;
  std::vector<Eigen::Vector3d> rays2;

  size_t size() const { return rays1.size(); }
  void Reserve(size_t size) {
    rays1.reserve(size);
    rays2.reserve(size);
  }
  void Add(const Eigen::Vector3d& ray1, const Eigen::Vector3d& ray2) {
    rays1.push_back(ray1);
    rays2.push_back(ray2);
  }
};

// --- Matrices and poses ---

// [t]_x R with t scaled to unit length.
Eigen::Matrix3d EssentialFromPose(const Rigid3& cam2_from_cam1);

// The four poses of an essential matrix, of any scale and sign: two rotations,
// each with t and -t.
std::array<Rigid3, 4> DecomposeEssential(const Eigen::Matrix3d& essential);

// A motion that a plane induces: H ~ R + t n^T for the plane n . x1 = 1.
struct PlanarMotion {
  Rigid3 cam2_from_cam1;         // translation over the distance of the plane
  Eigen::Vector3d plane_normal;  // unit, in camera 1; any for a pure rotation
};

// All motions that a homography of rays, f2 ~ H f1, of any scale and sign may
// stem from with both cameras on the same side of the plane: four, or one with
// zero translation if H is a rotation to `rotation_tolerance` (the largest
// over the smallest singular value, less 1). None if H is singular.
// Ma, Soatto, Kosecka, Sastry: An Invitation to 3-D Vision, 2004, chapter 5.3.
std::vector<PlanarMotion> DecomposeHomography(const Eigen::Matrix3d& homography,
                                              double rotation_tolerance = 1e-6);

// --- Errors of one match ---

// First order distance, in radians, of the match to the nearest one that meets
// the epipolar constraint, moving both rays:
//   r = e / sqrt(|t x a|^2 + |t x f2|^2 - 2 e^2).
// 0 where both rays lie on the baseline. Has a sign. The Jacobian, where asked
// for, is by `delta` of PerturbRelativePose.
double SampsonAngle(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
                    const Eigen::Vector3d& ray2,
                    Eigen::Matrix<double, 1, 5>* jacobian = nullptr);

// The larger of the angles of each ray to the plane through the baseline and
// the other ray.
double MaxEpipolarAngle(const Rigid3& cam2_from_cam1,
                        const Eigen::Vector3d& ray1,
                        const Eigen::Vector3d& ray2);

// Whether the rays meet at positive distances from both cameras, given that
// they meet: a and f2 are on the same side of the baseline, and turning a to f2
// turns towards t by an angle (the parallax) of -tolerance_rad or more. The
// tolerance keeps points too far away for their parallax to have a sure sign.
bool IsInFront(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
               const Eigen::Vector3d& ray2, double tolerance_rad);

// --- Errors of many matches ---

// Truncated squared errors: the sum of min(r^2, max_error^2), where matches
// that are not in front (to max_error) count as max_error^2.
struct PoseScore {
  double cost = 0.0;
  int num_inliers = 0;
};
PoseScore ScoreRelativePose(const RayMatches& matches,
                            const Rigid3& cam2_from_cam1, double max_error_rad);
// Of a rotation without translation, r = |R f1 - f2| / sqrt(2).
PoseScore ScoreRotation(const RayMatches& matches,
                        const Eigen::Quaterniond& cam2_from_cam1,
                        double max_error_rad);

// The inliers that the scores count.
bool IsInlier(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
              const Eigen::Vector3d& ray2, double max_error_rad);
bool IsRotationInlier(const Eigen::Quaterniond& cam2_from_cam1,
                      const Eigen::Vector3d& ray1, const Eigen::Vector3d& ray2,
                      double max_error_rad);

// The same for many matches: which are inliers, and |SampsonAngle|.
Mask FindInliers(const RayMatches& matches, const Rigid3& cam2_from_cam1,
                 double max_error_rad);
Mask FindRotationInliers(const RayMatches& matches,
                         const Eigen::Quaterniond& cam2_from_cam1,
                         double max_error_rad);
std::vector<double> SampsonAngles(const RayMatches& matches,
                                  const Rigid3& cam2_from_cam1);

// --- Refinement ---

// Both refinements minimise sum_i c^2 / 2 log(1 + r_i^2 / c^2), c = loss scale
// (Cauchy), and stop when
//   |step| <= step_tolerance_rad  or
//   cost decrease <= relative_cost_tolerance * cost.
struct PoseRefinementOptions {
  double loss_scale_rad = 1e-3;
  int max_num_iterations = 20;
  double step_tolerance_rad = 1e-9;
  double relative_cost_tolerance = 1e-6;
};

// R <- Exp(delta[0:3]) R, t <- t + B delta[3:5], scaled to unit length, where
// the columns of B are an orthonormal basis of the plane normal to t.
Rigid3 PerturbRelativePose(const Rigid3& cam2_from_cam1,
                           const Eigen::Matrix<double, 5, 1>& delta);

// Levenberg-Marquardt over the 5 degrees of freedom on SampsonAngle. Cost per
// iteration: one pass over the matches. kFailure with fewer than 5 matches.
SolveSummary RefineRelativePose(const RayMatches& matches,
                                const PoseRefinementOptions& options,
                                Rigid3* cam2_from_cam1);

// Robust Wahba problem, r = |R f1 - f2| / sqrt(2), by iteratively reweighted
// Gauss-Newton. kFailure with fewer than 2 matches.
SolveSummary RefineRotation(const RayMatches& matches,
                            const PoseRefinementOptions& options,
                            Eigen::Quaterniond* cam2_from_cam1);

// The unit direction t, up to its sign, that minimises the sum of
// (t . (R f1 x f2))^2.
Eigen::Vector3d FitDirection(const RayMatches& matches,
                             const Eigen::Quaterniond& cam2_from_cam1);

// --- Minimal solver and robust estimation ---

// All essential matrices (|E| = sqrt 2) through five matches: the action matrix
// of Stewenius, Engels, Nister: Recent developments on direct relative
// orientation, ISPRS 2006. Returns their number, up to 10; 0 for degenerate
// samples.
int SolveFivePoint(const std::array<Eigen::Vector3d, 5>& rays1,
                   const std::array<Eigen::Vector3d, 5>& rays2,
                   std::array<Eigen::Matrix3d, 10>* essentials);

// LO-RANSAC: five-point samples, PoseScore, and refinement on the inliers of
// every new best pose; as many trials as the inliers found so far ask for.
// nullopt with fewer than 5 matches, or when every sample was degenerate, as
// those of exact pure rotations are.
std::optional<Rigid3> EstimateRelativePose(const RayMatches& matches,
                                           const RansacOptions& options,
                                           Random* random);

// The same for a rotation without translation, on samples of two matches.
std::optional<Eigen::Quaterniond> EstimateRotation(const RayMatches& matches,
                                                   const RansacOptions& options,
                                                   Random* random);

}  // namespace mgsfm
