// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_components.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include "base/ranges.h"
#include "georegistration/gravity_leveling.h"
#include "math/graph.h"
#include "mgsfm/base/error.h"
#include "rotation_averaging/rotation_problem.h"

namespace mgsfm {
namespace {

ConnectedComponents FindFrameComponents(const Scene& scene,
                                        const ViewGraph& view_graph,
                                        const Mask& pair_is_kept) {
  std::vector<GraphEdge> edges;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (!pair_is_kept[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    const int frame1 = scene.images[pair.image_idx1].frame_idx;
    const int frame2 = scene.images[pair.image_idx2].frame_idx;
    if (frame1 != frame2) edges.push_back({frame1, frame2, 1.0});
  }
  return FindConnectedComponents(static_cast<int>(scene.frames.size()), edges);
}

// Per component: its position by descending size, then by first frame.
std::vector<int> RankBySize(const std::vector<int>& sizes) {
  std::vector<int> by_size = Indices(sizes.size());
  StableSortDescendingBy(&by_size, [&](int a) { return sizes[a]; });
  std::vector<int> rank(sizes.size());
  for (size_t i = 0; i < by_size.size(); ++i) {
    rank[by_size[i]] = static_cast<int>(i);
  }
  return rank;
}

}  // namespace

RotationEstimate RestrictToPairs(const Scene& scene,
                                 const ViewGraph& view_graph,
                                 const Mask& pair_is_kept,
                                 RotationEstimate estimate) {
  const size_t num_frames = scene.frames.size();
  MGSFM_CHECK_EQ(pair_is_kept.size(), view_graph.pairs.size());
  MGSFM_CHECK_EQ(estimate.rig_from_world.size(), num_frames);
  const ConnectedComponents components =
      FindFrameComponents(scene, view_graph, pair_is_kept);
  std::vector<int> sizes(components.num_components, 0);
  for (const int component : components.component) ++sizes[component];
  const std::vector<int> rank = RankBySize(sizes);
  estimate.component.assign(num_frames, std::nullopt);
  for (size_t f = 0; f < num_frames; ++f) {
    const int component = components.component[f];
    if (sizes[component] < 2) {
      estimate.rig_from_world[f].reset();
    } else if (estimate.rig_from_world[f]) {
      estimate.component[f] = rank[component];
    }
  }
  estimate.pair_is_inlier = pair_is_kept;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const int frame = scene.images[view_graph.pairs[i].image_idx1].frame_idx;
    if (!estimate.rig_from_world[frame]) estimate.pair_is_inlier[i] = false;
  }
  return estimate;
}

void SummarizeEstimate(const Scene& scene, const ViewGraph& view_graph,
                       const RotationEstimate& estimate,
                       const GravityPriors& gravity,
                       const RotationAveragingOptions& options,
                       RotationSummary* summary) {
  summary->num_components = 0;
  for (const std::optional<int>& component : estimate.component) {
    if (!component) continue;
    summary->num_components = std::max(summary->num_components, *component + 1);
  }
  summary->num_pairs_without_rotation = 0;
  summary->num_pairs_unobservable = 0;
  summary->num_pairs_dropped = 0;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair.relative_pose) {
      ++summary->num_pairs_without_rotation;
    } else if (!IsUsable(scene, pair, estimate.sensor_from_rig)) {
      ++summary->num_pairs_unobservable;
    } else if (!estimate.pair_is_inlier[i]) {
      ++summary->num_pairs_dropped;
    }
  }
  if (gravity.IsEmpty()) return;
  std::vector<std::optional<Eigen::Quaterniond>> cam_from_world;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    cam_from_world.push_back(estimate.CamFromWorld(scene, static_cast<int>(i)));
  }
  summary->gravity =
      EvaluateGravity(gravity, cam_from_world, options.gravity_sigma_deg);
}

}  // namespace mgsfm
