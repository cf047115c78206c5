// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/fleet/view_graph_partition.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <utility>

#include "base/ranges.h"
#include "math/graph_partition.h"
#include "mgsfm/base/mask.h"
#include "pair_filtering/frame_pair_index.h"
#include "pair_filtering/skeletal_graph.h"
#include "pair_filtering/triplet_consistency.h"

namespace mgsfm {
namespace {

std::vector<MatchedImages> CountMatches(const std::vector<PairMatches>& pairs) {
  return Transformed(pairs, [](const PairMatches& pair) {
    return MatchedImages{pair.image_idx1, pair.image_idx2, pair.matches.size()};
  });
}

// `support` are the triplet-consistent matches of each pair.
std::vector<GraphEdge> EdgesOfSkeleton(const FramePairIndex& index,
                                       const std::vector<MatchedImages>& pairs,
                                       const std::vector<int>& support,
                                       const PairFilteringOptions& filtering) {
  const std::vector<int> num_matches =
      Transformed(pairs, [](const MatchedImages& pair) {
        return static_cast<int>(pair.num_matches);
      });
  const Mask is_in_skeleton = SelectSkeletalGraph(
      index, num_matches, support, Mask(pairs.size(), true), filtering);
  std::vector<GraphEdge> edges;
  for (const FramePair& frames : index.frame_pairs()) {
    if (!frames.IsBetweenFrames()) continue;
    bool is_edge = false;
    double weight = 0.0;
    for (const size_t i : frames.pair_idxs) {
      is_edge |= is_in_skeleton[i];
      weight += support[i];
    }
    if (is_edge) {
      edges.push_back({frames.frame_idx1, frames.frame_idx2, weight});
    }
  }
  return edges;
}

std::vector<ClusterOverlap> CountCommonFrames(
    const std::vector<FrameCluster>& clusters) {
  std::map<int, std::vector<int>> clusters_of_frame;
  for (size_t i = 0; i < clusters.size(); ++i) {
    for (const int frame_idx : clusters[i].frame_idxs) {
      clusters_of_frame[frame_idx].push_back(static_cast<int>(i));
    }
  }
  std::map<std::pair<int, int>, int> num_frames;
  for (const auto& [frame_idx, of_frame] : clusters_of_frame) {
    for (size_t i = 0; i < of_frame.size(); ++i) {
      for (size_t k = i + 1; k < of_frame.size(); ++k) {
        ++num_frames[{of_frame[i], of_frame[k]}];
      }
    }
  }
  return Transformed(num_frames, [](const auto& entry) {
    const auto& [pair, number] = entry;
    return ClusterOverlap{pair.first, pair.second, number};
  });
}

// Per cluster and sensor: matches of its images within the cluster.
std::vector<std::vector<double>> CountMatchesOfSensors(
    const Scene& scene, const std::vector<MatchedImages>& pairs,
    const std::vector<FrameCluster>& clusters) {
  std::vector<std::vector<double>> counts;
  for (const FrameCluster& cluster : clusters) {
    Mask has_frame(scene.frames.size(), false);
    for (const int frame_idx : cluster.frame_idxs) has_frame[frame_idx] = true;
    std::vector<double> count(scene.sensors.size(), 0.0);
    for (const MatchedImages& pair : pairs) {
      const Image& image1 = scene.images[pair.image_idx1];
      const Image& image2 = scene.images[pair.image_idx2];
      if (!has_frame[image1.frame_idx] || !has_frame[image2.frame_idx]) {
        continue;
      }
      const auto num_matches = static_cast<double>(pair.num_matches);
      count[image1.sensor_idx] += num_matches;
      count[image2.sensor_idx] += num_matches;
    }
    counts.push_back(std::move(count));
  }
  return counts;
}

// For each rig of several sensors, the cluster in which its weakest sensor has
// the most matches.
std::vector<int> ChooseCalibrationClusters(
    const Scene& scene, const std::vector<MatchedImages>& pairs,
    const std::vector<FrameCluster>& clusters) {
  const auto counts = CountMatchesOfSensors(scene, pairs, clusters);
  std::vector<int> chosen;
  for (const Rig& rig : scene.rigs) {
    if (rig.sensor_idxs.size() < 2) continue;
    const auto weakest = Transformed(counts, [&](const auto& of_cluster) {
      double min = of_cluster[rig.ref_sensor_idx];
      for (const int sensor_idx : rig.sensor_idxs) {
        min = std::min(min, of_cluster[sensor_idx]);
      }
      return min;
    });
    const auto best = std::max_element(weakest.begin(), weakest.end());
    chosen.push_back(static_cast<int>(best - weakest.begin()));
  }
  SortUnique(&chosen);
  return chosen;
}

}  // namespace

ViewGraphPartition PartitionViewGraph(const Scene& scene,
                                      std::vector<PairMatches> pair_matches,
                                      const PairFilteringOptions& filtering,
                                      const PartitionOptions& options,
                                      const Context& context) {
  const std::vector<int> support =
      CountTripletConsistentMatches(&pair_matches, context);
  const std::vector<MatchedImages> pairs = CountMatches(pair_matches);
  std::vector<PairMatches>().swap(pair_matches);
  const FramePairIndex index(scene, pairs, filtering.is_sequence);
  GraphPartitionOptions graph_options;
  graph_options.num_parts = options.num_clusters;
  graph_options.num_overlap_nodes = options.num_overlap_frames;
  const GraphPartition parts = PartitionGraph(
      static_cast<int>(scene.frames.size()),
      EdgesOfSkeleton(index, pairs, support, filtering), graph_options);
  ViewGraphPartition partition;
  partition.clusters.resize(parts.nodes.size());
  for (size_t i = 0; i < parts.nodes.size(); ++i) {
    partition.clusters[i].frame_idxs = parts.nodes[i];
  }
  for (size_t i = 0; i < parts.part_of_node.size(); ++i) {
    if (parts.part_of_node[i]) {
      ++partition.clusters[*parts.part_of_node[i]].num_core_frames;
    } else {
      partition.frame_idxs_without_cluster.push_back(static_cast<int>(i));
    }
  }
  partition.overlaps = CountCommonFrames(partition.clusters);
  if (!partition.clusters.empty()) {
    partition.calibration_clusters =
        ChooseCalibrationClusters(scene, pairs, partition.clusters);
  }
  return partition;
}

}  // namespace mgsfm
