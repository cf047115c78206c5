// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "rotation_averaging/rotation_problem.h"

namespace mgsfm {

// Known initial rotations, in one world per connected component.
struct NodeStart {
  std::vector<std::optional<Eigen::Quaterniond>> rotations;  // per node
  std::vector<std::optional<int>> components;                // per node

  bool IsEmpty() const { return rotations.empty(); }
  bool Knows(int node1, int node2) const {
    return !IsEmpty() && rotations[node1] && rotations[node2] &&
           components[node1] == components[node2];
  }
};

// Start values of the nodes for given sensors. All edges between the same two
// nodes are merged into their weighted geodesic median; the support is the sum
// over the edges within `max_error_rad` of the median. The merged rotations are
// chained along a spanning forest of maximum support; the root of each tree
// gets the identity. Relative rotations between nodes of `start` replace merged
// ones. The parts that they connect, such as the images of sensors without
// overlap, are joined in the order of the forest, each time by the weighted
// geodesic median of all merged rotations between two parts.
void InitializeNodes(const RotationProblem& problem, double max_error_rad,
                     const NodeStart& start, RotationState* state);

}  // namespace mgsfm
