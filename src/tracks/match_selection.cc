// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/tracks/match_selection.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>

#include "mgsfm/base/error.h"
#include "mgsfm/base/parallel.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/epipolar.h"

namespace mgsfm {
namespace {

using Rays = std::vector<std::vector<Eigen::Vector3d>>;

// As the cameras of the model see them; zero where there is none.
Rays ComputeRays(const Scene& scene, const Reconstruction& model,
                 const Context& context) {
  Rays rays(scene.images.size());
  ParallelFor(
      rays.size(), context.num_threads,
      [&](size_t i) {
        const Image& image = scene.images[i];
        const Camera& camera = model.cameras[image.camera_idx];
        if (!model.IsRegistered(scene, static_cast<int>(i))) return;
        rays[i].reserve(image.keypoints_px.size());
        for (const Eigen::Vector2f& keypoint_px : image.keypoints_px) {
          rays[i].push_back(RayFromPixel(camera.model, camera.params.data(),
                                         keypoint_px.cast<double>())
                                .value_or(Eigen::Vector3d::Zero()));
        }
      },
      1);
  return rays;
}

bool Agrees(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
            const Eigen::Vector3d& ray2, double max_error_rad) {
  if (ray1.isZero() || ray2.isZero()) return false;
  return IsRotationInlier(cam2_from_cam1.rotation, ray1, ray2, max_error_rad) ||
         (!cam2_from_cam1.translation.isZero() &&
          IsInlier(cam2_from_cam1, ray1, ray2, max_error_rad));
}

class MatchSelector {
 public:
  MatchSelector(const Scene& scene, const ViewGraph& view_graph,
                const std::vector<char>& pair_is_used,
                const Reconstruction& model, double max_error_px,
                const MatchSelectionOptions& options, const Context& context)
      : scene_(scene),
        view_graph_(view_graph),
        model_(model),
        max_error_px_(max_error_px),
        options_(options),
        context_(context),
        rays_(ComputeRays(scene, model, context)) {
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
  const Rays rays_;
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
        Agrees(cam2_from_cam1, rays_[pair.image_idx1][match.keypoint_idx1],
               rays_[pair.image_idx2][match.keypoint_idx2], max_error_rad);
    selection_.match_is_used[first_match_[pair_idx] + i] = agrees;
    num_agreeing_[pair_idx] += agrees;
  }
}

void MatchSelector::DropFramePairs() {
  struct Votes {
    size_t num_matches = 0;
    size_t num_agreeing = 0;
  };
  std::map<std::pair<int, int>, Votes> votes_of_frames;
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    if (!selection_.pair_is_used[i]) continue;
    Votes& votes = votes_of_frames[FramesOf(i)];
    votes.num_matches += view_graph_.pairs[i].matches.size();
    votes.num_agreeing += num_agreeing_[i];
  }
  for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
    if (!selection_.pair_is_used[i]) continue;
    const Votes& votes = votes_of_frames[FramesOf(i)];
    if (votes.num_agreeing < options_.min_pair_share * votes.num_matches) {
      selection_.pair_is_used[i] = false;
    }
  }
}

}  // namespace

MatchSelection SelectConsistentMatches(const Scene& scene,
                                       const ViewGraph& view_graph,
                                       const std::vector<char>& pair_is_used,
                                       const Reconstruction& model,
                                       double max_error_px,
                                       const MatchSelectionOptions& options,
                                       const Context& context) {
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  MGSFM_CHECK_GT(max_error_px, 0.0);
  return MatchSelector(scene, view_graph, pair_is_used, model, max_error_px,
                       options, context)
      .Run();
}

}  // namespace mgsfm
