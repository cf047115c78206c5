// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The measurements of a sequence, as input of the estimation of its motion.
struct MotionInput {
  const Scene& scene;
  const Bearings& bearings;
  const FramePairIndex& index;  // of the view graph
  const ViewGraph& view_graph;
  const ViewGraph& matches;
  const RotationEstimate& rotations;
};

// The measurements of pairs within frames, in one unit of length.
struct FrameDepths {
  // Per sensor; nullopt if no pair within a frame connects it with the others.
  std::vector<std::optional<Rigid3>> cam_from_rig;
  // Per image and keypoint: distance along the ray. Empty for images without
  // distances.
  std::vector<std::vector<std::optional<double>>> distances;
  // Relative standard deviations of the distances. Empty if distances are
  // exact.
  std::vector<std::vector<double>> relative_sigmas;

  bool IsKnown(int image_idx, int keypoint_idx) const {
    return !distances[image_idx].empty() &&
           distances[image_idx][keypoint_idx].has_value();
  }
  double RelativeSigma(int image_idx, int keypoint_idx) const {
    return relative_sigmas.empty() ? 0.0
                                   : relative_sigmas[image_idx][keypoint_idx];
  }
};

struct DepthOptions {
  double min_parallax_deg = 0.0;
  double noise_px = 0.0;  // the standard deviation of keypoints
};

// The poses of the sensors in their rig, and the depths of keypoints with
// matches within frames, in an arbitrary unit of length.
//
// The direction t of the baseline of two sensors is the same in all frames, so
// that all their matches determine it together (geometry/epipolar.h),
//
//   min_t sum_m rho(r_m(R, t)),  |t| = 1,
//
// with the averaged rotation R, which also uses pairs between frames: the
// matches of a narrow overlap would determine only combinations of R and t. The
// scale of the loss rho is estimated from the residuals. Common keypoints
// relate the lengths of the baselines
// (translation_averaging/scale_averaging.h). Sensors are placed along the
// spanning tree of the most certain directions; the origin of a rig is one of
// them. Sensors without a baseline to the others have no pose. Cost: linear in
// the matches within frames; parallel over pairs of sensors.
[[nodiscard]] FrameDepths MeasureFrameDepths(const MotionInput& input,
                                             const DepthOptions& options,
                                             const Context& context);

// The angle of an error at the center of an image.
[[nodiscard]] double ErrorRad(const Scene& scene, int image_idx,
                              double error_px);

// Calls function(match, ray1, ray2) for all matches of a pair with rays.
template <typename Function>
void ForEachRays(const Bearings& bearings, const ImagePair& pair,
                 const Function& function) {
  for (const Match& match : pair.matches) {
    const auto keypoint1 = static_cast<int>(match.keypoint_idx1);
    const auto keypoint2 = static_cast<int>(match.keypoint_idx2);
    if (!bearings.HasRay(pair.image_idx1, keypoint1) ||
        !bearings.HasRay(pair.image_idx2, keypoint2)) {
      continue;
    }
    function(match, bearings.Ray(pair.image_idx1, keypoint1),
             bearings.Ray(pair.image_idx2, keypoint2));
  }
}

}  // namespace mgsfm
