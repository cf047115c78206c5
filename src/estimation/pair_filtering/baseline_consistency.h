// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Pairs of duplicate structures can have the right rotation, and on a straight
// road the right direction. Their length cannot be right: matches that they
// share with correct pairs determine it.

// The baseline m = c_2 - c_1 between the cameras of a pair as measured, in the
// unit of length of the positions it is compared with.
struct MeasuredBaseline {
  Eigen::Vector3d baseline_in_world = Eigen::Vector3d::Zero();
  double typical_depth = 0.0;  // median depth of the points of all pairs
  // False if matches do not link its length to that of most other pairs.
  bool is_comparable = true;
};

// Per pair of the view graph; nullopt for pairs without a measured baseline.
using MeasuredBaselines = std::vector<std::optional<MeasuredBaseline>>;
// Per image; nullopt for images without a position.
using CameraCenters = std::vector<std::optional<Eigen::Vector3d>>;

// A set of positions and the measured baselines in its unit of length.
struct BaselineComparison {
  MeasuredBaselines measured;
  CameraCenters centers;
};

// C = c_2 - c_1 of a pair; nullopt unless both images have a position.
[[nodiscard]] std::optional<Eigen::Vector3d> BaselineByPositions(
    const ImagePair& pair, const CameraCenters& centers);

// Pairs that the drift of the skeletal graph cannot explain. Positions from the
// skeletal graph alone drift in proportion to the path length l between two
// frames (drift_bound.h). With C = c_2 - c_1 by these positions, a comparable
// pair is inconsistent if
//
//   |C - m| > max_drift l + max_baseline_error_in_depths * typical depth.
//
// All pairs of the skeletal graph must have a measured baseline, except those
// within a frame. None is inconsistent if too many would be (pair_filtering.h).
// Per pair of the view graph. Cost: a path through a tree for each pair.
[[nodiscard]] Mask FindInconsistentBaselines(
    const PairEvidence& evidence, const Mask& is_in_skeleton,
    const BaselineComparison& by_skeleton, double max_drift);

// The drift bounds to try, largest first. Duplicate structures within the first
// bound can outvote the skeletal graph and break the trajectory. The bound is
// therefore tightened until no skeleton edge is violated.
std::vector<double> BaselineDriftBounds(const PairFilteringOptions& options);

// Pairs that contradict positions: with C as above,
//
//   |C - m| > max_relative_baseline_error * max(|C|, |m|)   and
//   |C - m| > max_baseline_error_in_depths * typical depth.
//
// The second condition spares loop closures, which miss by the drift. Per pair
// of the view graph; false where a baseline or a position is missing.
[[nodiscard]] Mask FindInconsistentPairs(const ViewGraph& view_graph,
                                         const BaselineComparison& comparison,
                                         const PairFilteringOptions& options);

// Number of pairs of the skeletal graph that its own positions satisfy and
// other positions violate: they contradict the pair, or do not contain both of
// its images.
int CountViolatedSkeletonEdges(const ViewGraph& view_graph,
                               const Mask& is_in_skeleton,
                               const BaselineComparison& by_skeleton,
                               const BaselineComparison& by_others,
                               const PairFilteringOptions& options);

}  // namespace mgsfm
