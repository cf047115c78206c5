// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "geometry/epipolar.h"
#include "geometry/ransac.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/random.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// The relative pose of two rigid units, each a set of cameras at known places
// in it, from the matches of all pairs of their cameras at once. Unlike that of
// two cameras, it has a length, in the unit of the places.

// Matches of a camera of unit 1 with one of unit 2.
struct UnitMatches {
  Rigid3 cam1_from_unit1;
  Rigid3 cam2_from_unit2;
  RayMatches rays;
  double max_error_rad = 2e-3;
};

// Unknown: unit2_from_unit1 = (R, t), with full length of t. For a pair of
// cameras it gives
//   cam2_from_cam1 = cam2_from_unit2 (R, t) cam1_from_unit1^-1,
// whose errors are those of epipolar.h, over max_error of the pair. Where the
// centres of both cameras coincide it is that of a rotation.

// The sum over all matches of min(r^2, 1); matches that are not in front of
// both cameras count 1.
PoseScore ScoreUnitPose(const std::vector<UnitMatches>& pairs,
                        const Rigid3& unit2_from_unit1);

// Which of the matches of a pair agree.
Mask FindUnitInliers(const UnitMatches& pair, const Rigid3& unit2_from_unit1);

// Minimises sum_i c^2 / 2 log(1 + r_i^2 / c^2), c = 1/2, over R and t by
// Levenberg-Marquardt, where r is the Sampson error; a step is
//   R <- Exp(delta[0:3]) R,  t <- t + delta[3:6].
// Stops when the cost falls by less than 1e-6 of itself, or after 10
// iterations. Directions of t that no match determines stay where they are.
// kFailure with fewer than 6 matches. Cost per iteration: one pass over the
// matches.
SolveSummary RefineUnitPose(const std::vector<UnitMatches>& pairs,
                            Rigid3* unit2_from_unit1);

// LO-RANSAC with samples of five matches of one pair of cameras, which give a
// pose up to the length of the translation between these two, and a match of
// any other pair, which gives the length (Clipp, Kim, Frahm, Pollefeys,
// Hartley: Robust 6DOF motion estimation for non-overlapping, multi-camera
// systems, WACV 2008). Pairs are drawn with their numbers of matches as
// weights. Starts from `guesses`: relative poses of pairs (index of the pair,
// cam2_from_cam1 with |t| = 1), of which only the length is sought. If one of
// them explains half of all matches nothing is sampled, as no other pose
// explains more. max_error_rad of the options has no effect. nullopt if no
// sample was of use, as with fewer than two pairs that have matches.
struct PairPose {
  size_t pair = 0;
  Rigid3 cam2_from_cam1;
};
std::optional<Rigid3> EstimateUnitPose(const std::vector<UnitMatches>& pairs,
                                       const std::vector<PairPose>& guesses,
                                       const RansacOptions& options,
                                       Random* random);

}  // namespace mgsfm
