// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <vector>

#include "base/random.h"
#include "geometry/ransac.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Two-view geometry on unit rays instead of image points, which supports any
// field of view: all errors are angles, and a point is in front of a camera if
// its distance along the ray is positive.
//
// Conventions: cam2_from_cam1 is (R, t), x2 = R x1 + t. Only the direction of t
// is observable, so relative poses have |t| = 1. For a match (f1, f2) and
// a = R f1,
//   e = f2 . (t x a) = f2^T E f1,  E = [t]_x R,
// is the volume spanned by both rays and the baseline. It vanishes if the rays
// intersect.

// Matching unit rays in two cameras. Both arrays have the same size.
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

// The four poses of an essential matrix of any scale and sign: two rotations,
// each with t and -t.
std::array<Rigid3, 4> DecomposeEssential(const Eigen::Matrix3d& essential);

// A motion and plane that induce a homography: H ~ R + t n^T, plane n . x1 = 1.
struct PlanarMotion {
  Rigid3 cam2_from_cam1;         // translation / distance of the plane
  Eigen::Vector3d plane_normal;  // unit, in camera 1; arbitrary for rotations
};

// Decomposes a homography of rays, f2 ~ H f1, of any scale and sign into the
// four motions with both cameras on the same side of the plane. If the ratio of
// the largest to the smallest singular value is at most 1 + rotation_tolerance,
// H is a rotation and there is one motion with zero translation. No motions if
// H is singular. Ma, Soatto, Kosecka, Sastry: An Invitation to 3-D Vision,
// 2004, chapter 5.3.
std::vector<PlanarMotion> DecomposeHomography(const Eigen::Matrix3d& homography,
                                              double rotation_tolerance = 1e-6);

// --- Errors of one match ---

// Signed Sampson error in radians, the first-order distance of both rays to the
// nearest match that satisfies the epipolar constraint:
//   r = e / sqrt(|t x a|^2 + |t x f2|^2 - 2 e^2).
// 0 if both rays lie on the baseline. The optional Jacobian is with respect to
// `delta` of PerturbRelativePose.
double SampsonAngle(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
                    const Eigen::Vector3d& ray2,
                    Eigen::Matrix<double, 1, 5>* jacobian = nullptr);

// Whether intersecting rays meet at positive distances from both cameras: a and
// f2 are on the same side of the baseline, and the rotation from a to f2 is
// towards t by a parallax of at least -tolerance_rad. The tolerance accepts
// distant points whose parallax has an uncertain sign.
bool IsInFront(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
               const Eigen::Vector3d& ray2, double tolerance_rad);

// --- Errors of many matches ---

// The truncated cost sum min(r^2, max_error^2). Matches that are not in front
// of both cameras, with tolerance max_error, contribute max_error^2.
struct PoseScore {
  double cost = 0.0;
  int num_inliers = 0;
};
PoseScore ScoreRelativePose(const RayMatches& matches,
                            const Rigid3& cam2_from_cam1, double max_error_rad);
// The same for a pure rotation with r = |R f1 - f2| / sqrt(2).
PoseScore ScoreRotation(const RayMatches& matches,
                        const Eigen::Quaterniond& cam2_from_cam1,
                        double max_error_rad);

// The inliers of the costs above.
bool IsInlier(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
              const Eigen::Vector3d& ray2, double max_error_rad);
bool IsRotationInlier(const Eigen::Quaterniond& cam2_from_cam1,
                      const Eigen::Vector3d& ray1, const Eigen::Vector3d& ray2,
                      double max_error_rad);

// The same for all matches, and |SampsonAngle| of all matches.
Mask FindInliers(const RayMatches& matches, const Rigid3& cam2_from_cam1,
                 double max_error_rad);
Mask FindRotationInliers(const RayMatches& matches,
                         const Eigen::Quaterniond& cam2_from_cam1,
                         double max_error_rad);
std::vector<double> SampsonAngles(const RayMatches& matches,
                                  const Rigid3& cam2_from_cam1);

// The other motion of the plane that holds most matches: a homography has up to
// two decompositions with points in front of both cameras, and if few matches
// lie elsewhere, both explain nearly all. nullopt if no plane holds half of the
// matches within the maximum error, or if the rotations differ by less than
// that. The plane is fitted to the inverse depths of up to 100 matches by
// re-weighted least squares.
std::optional<Rigid3> PlanarTwin(const RayMatches& matches,
                                 const Rigid3& cam2_from_cam1,
                                 double max_error_rad);

// --- Refinement ---

// Both refinements minimize the Cauchy loss sum_i c^2 / 2 log(1 + r_i^2 / c^2),
// c = loss scale, and stop when
//   |step| <= step_tolerance_rad  or
//   cost decrease <= relative_cost_tolerance * cost.
struct PoseRefinementOptions {
  double loss_scale_rad = 1e-3;
  int max_num_iterations = 20;
  double step_tolerance_rad = 1e-9;
  double relative_cost_tolerance = 1e-6;
  // RefineRelativePose refines the other part only.
  bool is_rotation_fixed = false;
  bool is_direction_fixed = false;
};

// R <- Exp(delta[0:3]) R, t <- t + B delta[3:5], normalized. The columns of B
// are an orthonormal basis of the plane normal to t.
Rigid3 PerturbRelativePose(const Rigid3& cam2_from_cam1,
                           const Eigen::Matrix<double, 5, 1>& delta);

// Levenberg-Marquardt on SampsonAngle with 5 degrees of freedom. kFailure for
// fewer than 5 matches. Cost: one pass over the matches per iteration.
SolveSummary RefineRelativePose(const RayMatches& matches,
                                const PoseRefinementOptions& options,
                                Rigid3* cam2_from_cam1);

// Standard deviation of the least certain component of the direction t, for
// residuals r with the standard deviation loss_scale_rad; infinity if no match
// constrains it. A fixed rotation counts as exact.
double DirectionSigmaRad(const RayMatches& matches,
                         const PoseRefinementOptions& options,
                         const Rigid3& cam2_from_cam1);

// Covariance of the rotation vector of Exp(w) R and of the direction t, for
// residuals with the standard deviation loss_scale_rad. Unconstrained
// coordinates have a standard deviation of one radian.
PoseMatrix RelativePoseCovariance(const RayMatches& matches,
                                  const PoseRefinementOptions& options,
                                  const Rigid3& cam2_from_cam1);

// Robust Wahba problem, r = |R f1 - f2| / sqrt(2), by iteratively reweighted
// Gauss-Newton. kFailure for fewer than 2 matches.
SolveSummary RefineRotation(const RayMatches& matches,
                            const PoseRefinementOptions& options,
                            Eigen::Quaterniond* cam2_from_cam1);

// The unit direction t, up to sign, that minimizes sum (t . (R f1 x f2))^2.
Eigen::Vector3d FitDirection(const RayMatches& matches,
                             const Eigen::Quaterniond& cam2_from_cam1);

// --- Minimal solver and robust estimation ---

// All essential matrices (|E| = sqrt 2) of five matches by the action matrix
// method (Stewenius, Engels, Nister: Recent developments on direct relative
// orientation, ISPRS 2006). Returns the number of solutions, up to 10; 0 for
// degenerate samples.
int SolveFivePoint(const std::array<Eigen::Vector3d, 5>& rays1,
                   const std::array<Eigen::Vector3d, 5>& rays2,
                   std::array<Eigen::Matrix3d, 10>* essentials);

// LO-RANSAC with five-point samples. Poses are scored by PoseScore, and each
// new best pose is refined on its inliers. The number of trials adapts to the
// inlier ratio. nullopt for fewer than 5 matches or if all samples are
// degenerate, as for exact pure rotations.
std::optional<Rigid3> EstimateRelativePose(const RayMatches& matches,
                                           const RansacOptions& options,
                                           Random* random);

// The same for a pure rotation from samples of two matches.
std::optional<Eigen::Quaterniond> EstimateRotation(const RayMatches& matches,
                                                   const RansacOptions& options,
                                                   Random* random);

}  // namespace mgsfm
