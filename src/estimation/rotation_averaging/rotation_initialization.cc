// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_initialization.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/graph.h"
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
  StableSortBy(&rotations, &NodeRotation::Nodes);
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

// Chains merged rotations along a forest; its roots get the identity.
void ChainAlong(const std::vector<NodeRotation>& merged,
                const std::vector<GraphEdge>& edges,
                const std::vector<int>& forest,
                std::vector<Quaterniond>* nodes) {
  for (const ForestStep& step :
       WalkForest(static_cast<int>(nodes->size()), edges, forest)) {
    if (!step.from) continue;
    const NodeRotation& r = merged[step.from->edge];
    const Quaterniond& parent = (*nodes)[step.from->parent];
    (*nodes)[step.node] = step.node == r.high
                              ? r.high_from_low * parent
                              : r.high_from_low.conjugate() * parent;
  }
}

// Parts of a graph. Each has a world of its own for the rotations of its nodes.
class Parts {
 public:
  Parts(const std::vector<NodeRotation>& merged,
        const std::vector<GraphEdge>& edges, const std::vector<int>& forest,
        std::vector<Quaterniond>* nodes)
      : merged_(merged), edges_of_node_(nodes->size()), nodes_(nodes) {
    const std::vector<GraphEdge> within =
        Transformed(forest, [&](int e) { return edges[e]; });
    const auto num_nodes = static_cast<int>(nodes->size());
    part_of_node_ = FindConnectedComponents(num_nodes, within).component;
    nodes_of_part_.resize(nodes->size());
    for (int node = 0; node < num_nodes; ++node) {
      nodes_of_part_[part_of_node_[node]].push_back(node);
    }
    for (size_t e = 0; e < merged.size(); ++e) {
      edges_of_node_[merged[e].low].push_back(e);
      edges_of_node_[merged[e].high].push_back(e);
    }
  }

  // Joins the parts of two nodes by the median of all rotations between them,
  // because a single one may be an outlier.
  void Join(int node1, int node2, double max_error_rad) {
    int larger = part_of_node_[node1], smaller = part_of_node_[node2];
    if (nodes_of_part_[larger].size() < nodes_of_part_[smaller].size()) {
      std::swap(larger, smaller);
    }
    std::vector<Quaterniond> smaller_from_larger;
    std::vector<double> weights;
    for (const int node : nodes_of_part_[smaller]) {
      for (const size_t e : edges_of_node_[node]) {
        const NodeRotation& r = merged_[e];
        const int other = r.low == node ? r.high : r.low;
        if (part_of_node_[other] != larger) continue;
        const Quaterniond node_from_other =
            r.high == node ? r.high_from_low : r.high_from_low.conjugate();
        smaller_from_larger.push_back((*nodes_)[node].conjugate() *
                                      node_from_other * (*nodes_)[other]);
        weights.push_back(r.weight);
      }
    }
    const Quaterniond median =
        FindGeodesicMedian(smaller_from_larger, weights, max_error_rad)
            .rotation;
    for (const int node : nodes_of_part_[smaller]) {
      (*nodes_)[node] = ((*nodes_)[node] * median).normalized();
      part_of_node_[node] = larger;
      nodes_of_part_[larger].push_back(node);
    }
    nodes_of_part_[smaller].clear();
  }

 private:
  const std::vector<NodeRotation>& merged_;
  std::vector<std::vector<size_t>> edges_of_node_;
  std::vector<Quaterniond>* nodes_;
  std::vector<int> part_of_node_;
  std::vector<std::vector<int>> nodes_of_part_;
};

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
  const std::vector<GraphEdge> edges =
      Transformed(merged, [](const NodeRotation& r) {
        return GraphEdge{r.low, r.high, r.support};
      });
  std::vector<int> within = MaximumSpanningForest(problem.num_nodes, edges);
  state->nodes.assign(problem.num_nodes, Quaterniond::Identity());
  std::vector<int> joints;
  if (!start.IsEmpty()) {
    const auto first_joint = std::stable_partition(
        within.begin(), within.end(),
        [&](int e) { return start.Knows(merged[e].low, merged[e].high); });
    joints.assign(first_joint, within.end());
    within.erase(first_joint, within.end());
  }
  ChainAlong(merged, edges, within, &state->nodes);
  if (joints.empty()) return;
  StableSortDescendingBy(&joints, [&](int a) { return merged[a].support; });
  Parts parts(merged, edges, within, &state->nodes);
  for (const int e : joints) {
    parts.Join(merged[e].low, merged[e].high, max_error_rad);
  }
}

}  // namespace mgsfm
