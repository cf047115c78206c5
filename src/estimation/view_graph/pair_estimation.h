// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/random.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/view_graph/view_graph_estimation.h"

namespace mgsfm::internal {

enum class PairOutcome {
  kFromRow,
  kDecomposed,
  kReestimated,
  kDroppedFewInliers,
  kDroppedConfig,
};

struct PairEstimate {
  PairOutcome outcome = PairOutcome::kDroppedConfig;
  ImagePair pair;     // set if IsKept()
  double cost = 0.0;  // truncated squared errors of all matches
  // Another pose that explains almost all matches, if most lie on a plane. Its
  // cost is not smaller.
  std::optional<ImagePair> twin;

  bool IsKept() const {
    return outcome == PairOutcome::kFromRow ||
           outcome == PairOutcome::kDecomposed ||
           outcome == PairOutcome::kReestimated;
  }
};

// nullopt for camera models with distortion.
std::optional<Eigen::Matrix3d> CalibrationMatrix(const Camera& camera);

// Estimates one pair; see EstimateViewGraph.
PairEstimate EstimatePair(const Scene& scene, const Bearings& bearings,
                          const ImagePair& pair,
                          const ViewGraphOptions& options, Random random);

// Two motions explain all matches of a plane. The few other matches do not tell
// which is right, since lenses and viewpoints displace keypoints by more than
// their noise. Rotations of three images tell: wrong ones do not close.
//
// Let p(a) be the probability of the motion a of a pair, and e(a, b, c) the
// angle by which the motions of three pairs do not close. With the prior p0,
//
//   log p(a) = log p0(a) + sum over triangles of
//              log sum over b, c of p(b) p(c) / (1 + e(a, b, c)^2 / s^2) +
//              const,
//
// where s is the robust standard deviation of the least closing errors of all
// triangles (mean field, 20 damped rounds). Swaps `pair` and `twin` of pairs
// whose twin is more probable. The result does not depend on the order of
// images. Cost: linear in the triangles with a pair that has a twin.
void ChooseTwins(std::vector<PairEstimate>* estimates);

}  // namespace mgsfm::internal
