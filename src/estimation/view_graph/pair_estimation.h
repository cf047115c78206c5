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

}  // namespace mgsfm::internal
