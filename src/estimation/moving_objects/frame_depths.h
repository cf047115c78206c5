// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "geometry/epipolar.h"
#include "mgsfm/base/context.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "moving_objects/rig_motions.h"
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

// The standard deviation of the Sampson errors of a relative pose, by their
// median: up to half of the matches may be wrong. `matches` must not be empty.
[[nodiscard]] double ResidualSigma(const RayMatches& matches,
                                   const Rigid3& cam2_from_cam1);

struct DepthOptions {
  // Smaller angles may be errors of calibration or of exposure times.
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
// them. Sensors without a baseline to the others have no pose. A match
// has no depth if the angle between its rays is below min_parallax_deg or below
// two standard deviations of its noise. Cost: linear in the matches within
// frames; parallel over pairs of sensors.
[[nodiscard]] FrameDepths MeasureFrameDepths(const MotionInput& input,
                                             const DepthOptions& options,
                                             const Context& context);

// The length L of the baseline of a pair of images of two frames, by keypoints
// with known distances d. A ray f of the first image is parallel to R f in the
// second one, and moves towards the direction t of the baseline by the parallax
// L s / d, with the sine s of the angle between R f and t,
//
//   min_L sum |p - L s / d|.
//
// Parallaxes p may be negative, so that L of a rig that stands differs from
// zero by noise only. nullopt without any. Cost: O(n log n) for n matches.
struct BaselineLength {
  double value = 0.0;
  double sigma = 0.0;
};
[[nodiscard]] std::optional<BaselineLength> MeasureBaselineLength(
    const Scene& scene, const Bearings& bearings, const ImagePair& pair,
    double noise_px, const FrameDepths& depths);

}  // namespace mgsfm
