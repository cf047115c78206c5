// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "rotation_averaging/rotation_problem.h"

namespace mgsfm {

// Averaging problems from the pairs of a view graph.

// A problem and, per edge, its pair in the view graph.
struct PairProblem {
  RotationProblem problem;
  std::vector<size_t> pair_idxs;
};

// Per sensor; nullopt: unknown.
using SensorFromRig = std::vector<std::optional<Eigen::Quaterniond>>;

// Nodes are images, all by one sensor whose rotation is the identity. With the
// joint strategy only pairs within a frame are edges.
PairProblem BuildImageProblem(const Scene& scene, const ViewGraph& view_graph,
                              const Mask& pair_is_used,
                              const RotationAveragingOptions& options);

// Whether a pair has a relative pose and the sensors of both images have a
// rotation.
bool IsUsable(const Scene& scene, const ImagePair& pair,
              const SensorFromRig& sensor_from_rig);

// Nodes are frames. Edges are the usable ones of the pairs used; all sensors
// are fixed.
PairProblem BuildFrameProblem(const Scene& scene, const ViewGraph& view_graph,
                              const Mask& pair_is_used,
                              const SensorFromRig& sensor_from_rig,
                              const RotationAveragingOptions& options);

// The problem without the edges from a node to itself.
RotationProblem WithoutLoops(const RotationProblem& problem);

// The problem of the edges whose residual is at most max_error_rad.
PairProblem KeepConsistentEdges(const PairProblem& pairs,
                                const RotationState& state,
                                double max_error_rad);

}  // namespace mgsfm
