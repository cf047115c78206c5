// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "rotation/rotation_problem.h"

namespace mgsfm {

// What is known of the nodes beforehand: rotations, in one world for each part.
struct NodeStart {
  std::vector<std::optional<Eigen::Quaterniond>> rotations;  // per node
  std::vector<std::optional<int>> parts;                     // per node

  bool IsEmpty() const { return rotations.empty(); }
  bool Knows(int node1, int node2) const {
    return !IsEmpty() && rotations[node1] && rotations[node2] &&
           parts[node1] == parts[node2];
  }
};

// Starting values of the nodes, given the sensors. All edges between the same
// two nodes are merged to their geodesic median (by weight); the support of
// that is the sum over the edges within `max_error_rad` of it. The merged
// rotations are chained along a spanning forest of maximum support; the root of
// each tree gets the identity. What `start` knows goes before all edges: they
// only tell which nodes belong together.
void InitializeNodes(const RotationProblem& problem, double max_error_rad,
                     const NodeStart& start, RotationState* state);

}  // namespace mgsfm
