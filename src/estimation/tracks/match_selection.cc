// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "geometry/epipolar.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/tracks/track_establishment.h"

namespace mgsfm {
namespace {

bool Agrees(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
            const Eigen::Vector3d& ray2, double max_error_rad) {
  return IsRotationInlier(cam2_from_cam1.rotation, ray1, ray2, max_error_rad) ||
         (!cam2_from_cam1.translation.isZero() &&
          IsInlier(cam2_from_cam1, ray1, ray2, max_error_rad));
}

double PixelsPerRadianOf(const Scene& scene, const Reconstruction& model,
                         int image_idx) {
  return PixelsPerRadian(model.cameras[scene.images[image_idx].camera_idx]);
}

// For each match of a pair, whether it agrees with the model; nullopt if an
// image has no pose.
std::optional<Mask> TestMatches(const Scene& scene, const ImagePair& pair,
                                const Reconstruction& model,
                                const Bearings& bearings, double max_error_px) {
  const auto cam1_from_world = model.CamFromWorld(scene, pair.image_idx1);
  const auto cam2_from_world = model.CamFromWorld(scene, pair.image_idx2);
  if (!cam1_from_world || !cam2_from_world) return std::nullopt;
  Rigid3 cam2_from_cam1 = *cam2_from_world * cam1_from_world->Inverse();
  cam2_from_cam1.translation.stableNormalize();
  const double max_error_rad =
      std::sqrt(2.0) * max_error_px * 0.5 *
      (1.0 / PixelsPerRadianOf(scene, model, pair.image_idx1) +
       1.0 / PixelsPerRadianOf(scene, model, pair.image_idx2));
  Mask agrees(pair.matches.size());
  for (size_t i = 0; i < pair.matches.size(); ++i) {
    const Match& match = pair.matches[i];
    agrees[i] = bearings.HasRay(pair.image_idx1, match.keypoint_idx1) &&
                bearings.HasRay(pair.image_idx2, match.keypoint_idx2) &&
                Agrees(cam2_from_cam1,
                       bearings.Ray(pair.image_idx1, match.keypoint_idx1),
                       bearings.Ray(pair.image_idx2, match.keypoint_idx2),
                       max_error_rad);
  }
  return agrees;
}

// Unsets pair_is_used for all pairs of two frames with too few agreeing
// matches.
void RejectFramePairs(const Scene& scene, const ViewGraph& view_graph,
                      const std::vector<size_t>& num_agreeing,
                      double min_pair_share, Mask* pair_is_used) {
  std::vector<std::pair<std::pair<int, int>, size_t>> order;  // by frames
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (!(*pair_is_used)[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    order.emplace_back(std::minmax({scene.images[pair.image_idx1].frame_idx,
                                    scene.images[pair.image_idx2].frame_idx}),
                       i);
  }
  std::sort(order.begin(), order.end());
  for (size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    size_t num_matches = 0, num_agreeing_of_frames = 0;
    for (; end < order.size() && order[end].first == order[begin].first;
         ++end) {
      num_matches += view_graph.pairs[order[end].second].matches.size();
      num_agreeing_of_frames += num_agreeing[order[end].second];
    }
    if (num_agreeing_of_frames >= min_pair_share * num_matches) continue;
    for (size_t k = begin; k < end; ++k) {
      (*pair_is_used)[order[k].second] = false;
    }
  }
}

}  // namespace

MatchSelection SelectConsistentMatches(const MatchSelectionInput& input,
                                       double max_error_px,
                                       const MatchSelectionOptions& options,
                                       const Context& context) {
  const Scene& scene = input.scene;
  const ViewGraph& view_graph = input.view_graph;
  const Mask& pair_is_used = input.pair_is_used;
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  MGSFM_CHECK_GT(max_error_px, 0.0);
  const Bearings bearings =
      ComputeBearings(scene, input.model.cameras, context.num_threads);
  std::vector<size_t> first_match = {0};
  for (const ImagePair& pair : view_graph.pairs) {
    first_match.push_back(first_match.back() + pair.matches.size());
  }
  MatchSelection selection{pair_is_used, Mask(first_match.back(), false)};
  std::vector<size_t> num_agreeing(view_graph.pairs.size(), 0);
  ParallelFor(
      view_graph.pairs.size(), context.num_threads,
      [&](size_t i) {
        if (!pair_is_used[i]) return;
        const auto agrees = TestMatches(scene, view_graph.pairs[i], input.model,
                                        bearings, max_error_px);
        selection.pair_is_used[i] = agrees.has_value();
        for (size_t k = 0; agrees && k < agrees->size(); ++k) {
          selection.match_is_used[first_match[i] + k] = (*agrees)[k];
          num_agreeing[i] += (*agrees)[k];
        }
      },
      /*block_size=*/16);
  RejectFramePairs(scene, view_graph, num_agreeing, options.min_pair_share,
                   &selection.pair_is_used);
  return selection;
}

}  // namespace mgsfm
