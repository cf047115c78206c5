// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// An estimate from the skeletal graph alone drifts along the path between two
// frames. Paths lead through its maximum spanning tree, weighted by the number
// of matches. Between two components, only the parts of the path inside them
// count. If a rule would reject more than a third of the pairs that it judges,
// the skeletal graph must be wrong rather than the pairs, and the rule rejects
// none.

// The rotations of both images of a pair; nullopt unless the estimate relates
// them.
[[nodiscard]] std::optional<std::pair<Eigen::Quaterniond, Eigen::Quaterniond>>
RotationsOfImages(const Scene& scene, const ImagePair& pair,
                  const RotationEstimate& rotations);

// Pairs whose relative rotation differs from the rotations of the skeletal
// graph by more than its drift explains. Duplicate structures are often only
// some degrees off; many of them break the trajectory where only few correct
// pairs connect it.
//
// Let d be the angle between the relative rotation of a pair and that of the
// skeleton, sigma the robust standard deviation of all d per axis, and l the
// number of edges between the two frames along the skeleton. A pair outside the
// skeleton is inconsistent if
//
//   d > max_rotation_error + min(rotation_drift_in_sigmas * sigma * sqrt(l),
//                                max_rotation_drift):
//
// drift is modeled as a random walk with steps of standard deviation sigma.
// Pairs of frames that the skeleton does not connect are not judged. Per pair.
// Cost: a path through a tree for each pair.
[[nodiscard]] Mask FindInconsistentRotations(
    const PairEvidence& evidence, const Mask& is_in_skeleton,
    const RotationEstimate& by_skeleton);

// Pairs of duplicate structures can have the correct rotation, and on a
// straight road the correct direction. Their baseline length is wrong, and
// matches that they share with correct pairs measure it.

// The baseline m = c_2 - c_1 between the cameras of a pair as measured, in the
// unit of length of the positions that it is compared with.
struct MeasuredBaseline {
  Eigen::Vector3d baseline_in_world = Eigen::Vector3d::Zero();
  double typical_depth = 0.0;  // median depth of the points of all pairs
  // False if matches do not link the length to that of most other pairs.
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

// Pairs that the drift of the skeletal graph cannot explain. Errors of scale
// and heading persist, so that its positions drift in proportion to the path
// length l between two frames. With C = c_2 - c_1 by these positions, a
// comparable pair is inconsistent if
//
//   |C - m| > max_drift l + max_baseline_error_in_depths * typical depth.
//
// All pairs of the skeletal graph must have a measured baseline, except those
// within a frame. Per pair of the view graph. Cost: a path through a tree for
// each pair.
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
// The second condition spares loop closures, whose error is the drift. Per pair
// of the view graph; false where a baseline or a position is missing.
[[nodiscard]] Mask FindInconsistentPairs(const ViewGraph& view_graph,
                                         const BaselineComparison& comparison,
                                         const PairFilteringOptions& options);

// Number of pairs of the skeletal graph that its own positions satisfy and
// other positions violate: these positions contradict the pair, or lack one of
// its images.
int CountViolatedSkeletonEdges(const ViewGraph& view_graph,
                               const Mask& is_in_skeleton,
                               const BaselineComparison& by_skeleton,
                               const BaselineComparison& by_others,
                               const PairFilteringOptions& options);

}  // namespace mgsfm
