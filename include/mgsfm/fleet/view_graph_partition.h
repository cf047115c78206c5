// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/pair_matches.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Clusters of whole frames that can be mapped separately and joined afterwards.
//
// The skeletal graph (mgsfm/pair_filtering/pair_filtering.h), whose edges are
// weighted by triplet-consistent matches, is cut into connected clusters of
// similar size (src/foundation/math/graph_partition.h), never at a weak seam.
// Neighboring clusters overlap, so that common frames determine their relative
// pose. Keypoints are not needed, and the relative poses of pairs are not used.

struct PartitionOptions {
  Option<int> num_clusters{
      "partition", 0, AtLeast(0), "clusters",
      "Cut the view graph into about this many overlapping clusters of frames "
      "and write lists of their images, instead of reconstructing. 0 "
      "reconstructs."};
  Option<int> num_overlap_frames{
      "partition_overlap", 5, AtLeast(3), "frames",
      "Let both clusters have this many frames on either side of a cut."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(num_clusters, num_overlap_frames);
  }
};

struct FrameCluster {
  std::vector<int> frame_idxs;  // including the overlap, ascending
  int num_core_frames = 0;      // without the overlap
};

// Two clusters with common frames.
struct ClusterOverlap {
  int cluster1 = 0;  // < cluster2
  int cluster2 = 0;
  int num_frames = 0;
};

struct ViewGraphPartition {
  std::vector<FrameCluster> clusters;
  std::vector<ClusterOverlap> overlaps;
  // The clusters whose models calibrate the rigs with several sensors: for each
  // rig, the cluster in which the sensor with the fewest matches has the most.
  std::vector<int> calibration_clusters;
  std::vector<int> frame_idxs_without_cluster;  // too weakly connected
};

// The matches are released as soon as they are counted.
[[nodiscard]] ViewGraphPartition PartitionViewGraph(
    const Scene& scene, std::vector<PairMatches> pair_matches,
    const PairFilteringOptions& filtering, const PartitionOptions& options,
    const Context& context);

}  // namespace mgsfm
