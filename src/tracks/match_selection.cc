// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/tracks/match_selection.h"

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

namespace mgsfm {
namespace {

bool Agrees(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
            const Eigen::Vector3d& ray2, double max_error_rad) {
  return IsRotationInlier(cam2_from_cam1.rotation, ray1, ray2, max_error_rad) ||
         (!cam2_from_cam1.translation.isZero() &&
          IsInlier(cam2_from_cam1, ray1, ray2, max_error_rad));
}

class MatchSelector {
 public:
  MatchSelector(const Scene& scene, const ViewGraph& view_graph,
                const Mask& pair_is_used, const Reconstruction& model,
                double max_error_px, const MatchSelectionOptions& options,
                const Context& context)
      : scene_(scene),
        view_graph_(view_graph),
        model_(model),
        max_error_px_(max_error_px),
        options_(options),
        context_(context),
        bearings_(ComputeBearings(scene, model.cameras, context.num_threads)) {
    selection_.pair_is_used = pair_is_used;
    for (const ImagePair& pair : view_graph.pairs) {
      first_match_.push_back(first_match_.back() + pair.matches.size());
    }
    selection_.match_is_used.assign(first_match_.back(), false);
    num_agreeing_.assign(view_graph.pairs.size(), 0);
  }

  MatchSelection Run() {
    ParallelFor(
        view_graph_.pairs.size(), context_.num_threads,
        [this](size_t i) { TestPair(i); }, 16);
    DropFramePairs();
    return std::move(selection_);
  }

 private:
  void TestPair(size_t pair_idx);
  void DropFramePairs();
  std::pair<int, int> FramesOf(size_t pair_idx) const {
    const ImagePair& pair = view_graph_.pairs[pair_idx];
    return std::minmax({scene_.images[pair.image_idx1].frame_idx,
                        scene_.images[pair.image_idx2].frame_idx});
  }
  double PixelsPerRadianOf(int image_idx) const {
    const Camera& camera = model_.cameras[scene_.images[image_idx].camera_idx];
    return PixelsPerRadian(camera.model, camera.params.data());
  }

  const Scene& scene_;
  const ViewGraph& view_graph_;
  const Reconstruction& model_;
  const double max_error_px_;
  const MatchSelectionOptions& options_;
  const Context& context_;
  const Bearings bearings_;
  std::vector<size_t> first_match_ = {0};  // per pair, and the end
  std::vector<size_t> num_agreeing_;       // matches, per pair
  MatchSelection selection_;
};

void MatchSelector::TestPair(size_t pair_idx) {
  if (!selection_.pair_is_used[pair_idx]) return;
  const ImagePair& pair = view_graph_.pairs[pair_idx];
  const auto cam1_from_world = model_.CamFromWorld(scene_, pair.image_idx1);
  const auto cam2_from_world = model_.CamFromWorld(scene_, pair.image_idx2);
  if (!cam1_from_world || !cam2_from_world) {
    selection_.pair_is_used[pair_idx] = false;
    return;
  }
  Rigid3 cam2_from_cam1 = *cam2_from_world * cam1_from_world->Inverse();
  cam2_from_cam1.translation.stableNormalize();
  const double max_error_rad = std::sqrt(2.0) * max_error_px_ * 0.5 *
                               (1.0 / PixelsPerRadianOf(pair.image_idx1) +
                                1.0 / PixelsPerRadianOf(pair.image_idx2));
  for (size_t i = 0; i < pair.matches.size(); ++i) {
    const Match& match = pair.matches[i];
    const bool agrees =
        bearings_.HasRay(pair.image_idx1, match.keypoint_idx1) &&
        bearings_.HasRay(pair.image_idx2, match.keypoint_idx2) &&
        Agrees(
            cam2_from_cam1, bearings_.Ray(pair.image_idx1, match.keypoint_idx1),
            bearings_.Ray(pair.image_idx2, match.keypoint_idx2), max_error_rad);
    selection_.match_is_used[first_match_[pair_idx] + i] = agrees;
    num_agreeing_[pair_idx] += agrees;
  }
}

void MatchSelector::DropFramePairs() {
  std::vector<std::pair<std::pair<int, int>, size_t>> order;  // by frames
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    if (selection_.pair_is_used[i]) order.emplace_back(FramesOf(i), i);
  }
  std::sort(order.begin(), order.end());
  for (size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    size_t num_matches = 0, num_agreeing = 0;
    for (; end < order.size() && order[end].first == order[begin].first;
         ++end) {
      num_matches += view_graph_.pairs[order[end].second].matches.size();
      num_agreeing += num_agreeing_[order[end].second];
    }
    if (num_agreeing >= options_.min_pair_share * num_matches) continue;
    for (size_t k = begin; k < end; ++k) {
      selection_.pair_is_used[order[k].second] = false;
    }
  }
}

}  // namespace

MatchSelection SelectConsistentMatches(
    const Scene& scene, const ViewGraph& view_graph, const Mask& pair_is_used,
    const Reconstruction& model, double max_error_px,
    const MatchSelectionOptions& options, const Context& context) {
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  MGSFM_CHECK_GT(max_error_px, 0.0);
  return MatchSelector(scene, view_graph, pair_is_used, model, max_error_px,
                       options, context)
      .Run();
}

}  // namespace mgsfm
