// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "base/random.h"
#include "geometry/epipolar.h"
#include "geometry/ransac.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// The generalized relative pose of two rigid units, each a set of cameras with
// known poses in the unit, from the matches of all pairs of their cameras.
// Unlike for two single cameras, the length of the translation is observable.

// Matches between a camera of unit 1 and a camera of unit 2.
struct UnitMatches {
  Rigid3 cam1_from_unit1;
  Rigid3 cam2_from_unit2;
  RayMatches rays;
  double max_error_rad = 2e-3;
};

// Unknown: unit2_from_unit1 = (R, t) including the length of t. The relative
// pose of a pair of cameras is
//   cam2_from_cam1 = cam2_from_unit2 (R, t) cam1_from_unit1^-1,
// with the errors r of epipolar.h divided by max_error of the pair. If the
// centers of both cameras coincide, r is the error of a pure rotation.

// The truncated cost sum min(r^2, 1) over all matches. Matches that are not in
// front of both cameras contribute 1.
PoseScore ScoreUnitPose(const std::vector<UnitMatches>& pairs,
                        const Rigid3& unit2_from_unit1);

// The inliers among the matches of a pair.
Mask FindUnitInliers(const UnitMatches& pair, const Rigid3& unit2_from_unit1);

// Minimizes sum_i c^2 / 2 log(1 + r_i^2 / c^2), c = 1/2, over R and t by
// Levenberg-Marquardt, where r is the Sampson error; a step is
//   R <- Exp(delta[0:3]) R,  t <- t + delta[3:6].
// Stops when the relative decrease of the cost is below 1e-6, or after 10
// iterations. Components of t that no match determines do not change. kFailure
// for fewer than 6 matches. Cost: one pass over the matches per iteration.
SolveSummary RefineUnitPose(const std::vector<UnitMatches>& pairs,
                            Rigid3* unit2_from_unit1);

// LO-RANSAC on samples of five matches of one pair of cameras, which determine
// the pose up to the baseline length, and one match of another pair, which
// determines the length (Clipp, Kim, Frahm, Pollefeys, Hartley: Robust 6DOF
// motion estimation for non-overlapping, multi-camera systems, WACV 2008).
// Pairs are drawn with probability proportional to their number of matches.
// `guesses` are initial relative poses of pairs (index of the pair,
// cam2_from_cam1 with |t| = 1), for which only the length is estimated. No
// samples are drawn if a guess explains half of all matches, because no other
// pose can explain more. max_error_rad of the options is ignored. nullopt if no
// sample yields a pose, e.g. if fewer than two pairs have matches.
struct PairPose {
  size_t pair = 0;
  Rigid3 cam2_from_cam1;
};
std::optional<Rigid3> EstimateUnitPose(const std::vector<UnitMatches>& pairs,
                                       const std::vector<PairPose>& guesses,
                                       const RansacOptions& options,
                                       Random* random);

}  // namespace mgsfm
