// SPDX-License-Identifier: BSD-3-Clause
#include "math/graph_partition.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <queue>
#include <tuple>
#include <utility>

#include "base/ranges.h"
#include "math/spanning_tree.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

class Partitioner {
 public:
  Partitioner(int num_nodes, const std::vector<GraphEdge>& edges,
              const GraphPartitionOptions& options)
      : edges_(edges), options_(options), neighbors_(num_nodes) {
    const std::vector<int> forest = MaximumSpanningForest(num_nodes, edges);
    steps_ = WalkForest(num_nodes, edges, forest);
    const std::vector<double> weights =
        Transformed(forest, [&](int e) { return edges[e].weight; });
    if (!weights.empty()) {
      min_weight_ = options.min_relative_weight * Median(weights);
    }
    for (const GraphEdge& edge : edges) {
      neighbors_[edge.node1].push_back({edge.weight, edge.node2});
      neighbors_[edge.node2].push_back({edge.weight, edge.node1});
    }
  }

  GraphPartition Run() {
    SplitComponents();
    GraphPartition result = NumberParts();
    AddOverlap(&result);
    return result;
  }

 private:
  using Neighbor = std::pair<double, int>;  // weight, node
  // A connected set of nodes: the steps of a forest traversal, parents first.
  using NodeSet = std::vector<ForestStep>;
  // A cut: the position of the step whose edge to its parent is removed.
  struct Cut {
    size_t step = 0;
    int num_parts_below = 0;
  };

  void SplitComponents() {
    std::vector<NodeSet> components;
    size_t num_nodes = 0;
    for (const ForestStep& step : steps_) {
      if (!step.from) components.emplace_back();
      components.back().push_back(step);
    }
    const auto is_small = [&](const NodeSet& set) {
      return static_cast<int>(set.size()) < options_.min_num_nodes;
    };
    EraseIf(&components, is_small);
    for (const NodeSet& set : components) num_nodes += set.size();
    for (NodeSet& set : components) {
      const double share =
          static_cast<double>(set.size()) / static_cast<double>(num_nodes);
      const auto num_parts =
          static_cast<int>(std::lround(share * options_.num_parts));
      Split(std::move(set), std::max(1, num_parts));
    }
  }

  void Split(NodeSet set, int num_parts) {
    std::vector<std::pair<NodeSet, int>> open;
    open.emplace_back(std::move(set), num_parts);
    while (!open.empty()) {
      const auto [nodes, num_wanted] = std::move(open.back());
      open.pop_back();
      const std::optional<Cut> cut = ChooseCut(nodes, num_wanted);
      if (!cut) {
        parts_.push_back(nodes);
        continue;
      }
      cut_edges_.push_back(nodes[cut->step].from->edge);
      auto [above, below] = Separate(nodes, cut->step);
      open.emplace_back(std::move(above), num_wanted - cut->num_parts_below);
      open.emplace_back(std::move(below), cut->num_parts_below);
    }
  }

  std::optional<Cut> ChooseCut(const NodeSet& set, int num_parts) const {
    if (num_parts < 2) return std::nullopt;
    std::vector<int> num_below(neighbors_.size(), 0);
    for (size_t i = set.size(); i-- > 1;) {
      num_below[set[i].node] += 1;
      num_below[set[i].from->parent] += num_below[set[i].node];
    }
    const double size =
        static_cast<double>(set.size()) / static_cast<double>(num_parts);
    std::optional<Cut> best;
    std::tuple<double, double> best_key;
    for (size_t i = 1; i < set.size(); ++i) {
      const double weight = edges_[set[i].from->edge].weight;
      if (weight < min_weight_) continue;
      const double multiple = num_below[set[i].node] / size;
      const int num_parts_below =
          std::clamp(static_cast<int>(std::lround(multiple)), 1, num_parts - 1);
      const double imbalance = std::abs(multiple - num_parts_below);
      // Distance of a cut from a multiple of the target size, in part sizes. Up
      // to 0.1 counts as exact; beyond 0.5, another multiple is closer.
      if (imbalance > 0.5) continue;
      // Smaller is better.
      const std::tuple<double, double> key(std::max(imbalance, 0.1), -weight);
      if (best && key >= best_key) continue;
      best = Cut{i, num_parts_below};
      best_key = key;
    }
    return best;
  }

  std::pair<NodeSet, NodeSet> Separate(const NodeSet& set, size_t step) const {
    Mask is_below(neighbors_.size(), false);
    std::pair<NodeSet, NodeSet> sides;
    for (size_t i = 0; i < set.size(); ++i) {
      ForestStep next = set[i];
      if (i == step) next.from.reset();
      if (i == step || (next.from && is_below[next.from->parent])) {
        is_below[next.node] = true;
        sides.second.push_back(next);
      } else {
        sides.first.push_back(next);
      }
    }
    return sides;
  }

  GraphPartition NumberParts() const {
    GraphPartition result;
    result.part_of_node.resize(neighbors_.size());
    for (const NodeSet& set : parts_) {
      std::vector<int> nodes = Transformed(set, &ForestStep::node);
      std::sort(nodes.begin(), nodes.end());
      result.nodes.push_back(std::move(nodes));
    }
    std::sort(result.nodes.begin(), result.nodes.end());
    for (size_t part = 0; part < result.nodes.size(); ++part) {
      for (const int node : result.nodes[part]) {
        result.part_of_node[node] = static_cast<int>(part);
      }
    }
    return result;
  }

  // Nodes to add to the part of `node`, most strongly connected first.
  std::vector<int> Grow(const GraphPartition& partition, int node) const {
    std::vector<int> grown;
    Mask is_grown(neighbors_.size(), false);
    // The strongest edge first, then the smallest node.
    const auto is_weaker = [](const Neighbor& a, const Neighbor& b) {
      return a.first != b.first ? a.first < b.first : a.second > b.second;
    };
    std::priority_queue<Neighbor, std::vector<Neighbor>, decltype(is_weaker)>
        border(is_weaker);
    border.push({0.0, node});
    while (!border.empty() &&
           static_cast<int>(grown.size()) < options_.num_overlap_nodes) {
      const int next = border.top().second;
      border.pop();
      if (is_grown[next]) continue;
      is_grown[next] = true;
      grown.push_back(next);
      for (const Neighbor& neighbor : neighbors_[next]) {
        if (partition.part_of_node[neighbor.second] ==
            partition.part_of_node[node]) {
          border.push(neighbor);
        }
      }
    }
    return grown;
  }

  void AddOverlap(GraphPartition* partition) const {
    std::vector<std::vector<int>>& nodes = partition->nodes;
    for (const int e : cut_edges_) {
      const int u = edges_[e].node1;
      const int v = edges_[e].node2;
      for (const auto& [from, to] : {std::make_pair(u, v), {v, u}}) {
        const std::vector<int> grown = Grow(*partition, from);
        std::vector<int>& of_part = nodes[*partition->part_of_node[to]];
        of_part.insert(of_part.end(), grown.begin(), grown.end());
      }
    }
    for (std::vector<int>& of_part : nodes) SortUnique(&of_part);
  }

  const std::vector<GraphEdge>& edges_;
  const GraphPartitionOptions& options_;
  std::vector<std::vector<Neighbor>> neighbors_;
  std::vector<ForestStep> steps_;
  double min_weight_ = 0.0;
  std::vector<NodeSet> parts_;
  std::vector<int> cut_edges_;
};

}  // namespace

GraphPartition PartitionGraph(int num_nodes,
                              const std::vector<GraphEdge>& edges,
                              const GraphPartitionOptions& options) {
  return Partitioner(num_nodes, edges, options).Run();
}

}  // namespace mgsfm
