// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_initialization.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "math/spanning_tree.h"
#include "rotation_averaging/geodesic_median.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

// The relative rotation of the nodes low < high by one edge.
struct NodeRotation {
  int low;
  int high;
  Quaterniond high_from_low;
  double weight;
  double support;

  std::pair<int, int> Nodes() const { return {low, high}; }
};

// Sorted by nodes; edges between the same nodes keep their order.
std::vector<NodeRotation> CollectNodeRotations(const RotationProblem& problem,
                                               const RotationState& state) {
  std::vector<NodeRotation> rotations;
  for (const RotationEdge& edge : problem.edges) {
    if (edge.node1 == edge.node2) continue;
    const Quaterniond node2_from_node1 =
        state.sensors[edge.sensor2].conjugate() * edge.cam2_from_cam1 *
        state.sensors[edge.sensor1];
    if (edge.node1 < edge.node2) {
      rotations.push_back({edge.node1, edge.node2, node2_from_node1,
                           edge.weight, edge.support});
    } else {
      rotations.push_back({edge.node2, edge.node1, node2_from_node1.conjugate(),
                           edge.weight, edge.support});
    }
  }
  std::stable_sort(rotations.begin(), rotations.end(),
                   [](const NodeRotation& a, const NodeRotation& b) {
                     return a.Nodes() < b.Nodes();
                   });
  return rotations;
}

NodeRotation Merge(const NodeRotation* begin, const NodeRotation* end,
                   double max_error_rad) {
  if (end - begin == 1) return *begin;
  std::vector<Quaterniond> samples;
  std::vector<double> weights;
  for (const NodeRotation* r = begin; r != end; ++r) {
    samples.push_back(r->high_from_low);
    weights.push_back(r->weight);
  }
  NodeRotation merged = *begin;
  merged.high_from_low =
      FindGeodesicMedian(samples, weights, max_error_rad).rotation;
  merged.support = 0.0;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (AngleBetween(samples[i], merged.high_from_low) <= max_error_rad) {
      merged.support += begin[i].support;
    }
  }
  return merged;
}

std::vector<NodeRotation> MergeParallel(
    const std::vector<NodeRotation>& rotations, double max_error_rad) {
  std::vector<NodeRotation> merged;
  for (size_t begin = 0, end = 0; begin < rotations.size(); begin = end) {
    while (end < rotations.size() &&
           rotations[end].Nodes() == rotations[begin].Nodes()) {
      ++end;
    }
    merged.push_back(
        Merge(rotations.data() + begin, rotations.data() + end, max_error_rad));
  }
  return merged;
}

}  // namespace

void InitializeNodes(const RotationProblem& problem, double max_error_rad,
                     const NodeStart& start, RotationState* state) {
  std::vector<NodeRotation> merged =
      MergeParallel(CollectNodeRotations(problem, *state), max_error_rad);
  for (NodeRotation& r : merged) {
    if (!start.Knows(r.low, r.high)) continue;
    r.high_from_low =
        *start.rotations[r.high] * start.rotations[r.low]->conjugate();
    // Exceeds any number of matches.
    r.support += 1e12;
  }
  std::vector<GraphEdge> edges;
  edges.reserve(merged.size());
  for (const NodeRotation& r : merged) {
    edges.push_back({r.low, r.high, r.support});
  }
  const std::vector<int> forest =
      MaximumSpanningForest(problem.num_nodes, edges);
  state->nodes.assign(problem.num_nodes, Quaterniond::Identity());
  for (const ForestStep& step : WalkForest(problem.num_nodes, edges, forest)) {
    if (!step.from) continue;
    const NodeRotation& r = merged[step.from->edge];
    const Quaterniond& parent = state->nodes[step.from->parent];
    state->nodes[step.node] = step.node == r.high
                                  ? r.high_from_low * parent
                                  : r.high_from_low.conjugate() * parent;
  }
}

}  // namespace mgsfm
