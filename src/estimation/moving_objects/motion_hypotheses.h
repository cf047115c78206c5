// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "moving_objects/frame_depths.h"
#include "moving_objects/motion_candidates.h"
#include "moving_objects/rig_motions.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Hypotheses for the motion of a rig between two frames of a sequence.
//
// Matches of keypoints with depth determine a motion with its distance, but
// where a vehicle fills the overlapping views, few of them show the static
// scene. Single cameras that look elsewhere still see it. Their relative poses
// have the right rotation and direction, without a distance.

// The measurements, and the settings that all steps share.
struct MotionProblem : MotionInput {
  const FramePairIndex& matches_index;
  const FrameDepths& depths;
  double max_error_px;
  double max_relative_baseline_error;
  // The median displacement of the rig that moves a keypoint by max_error_px.
  double noise_displacement = 0.0;

  FrameMatches MatchesOf(int earlier, const FramePair& frames) const {
    return {scene, bearings, matches, depths, earlier, frames.pair_idxs};
  }
};

// The relative pose of a pair of `earlier_frame_idx` and another frame, given
// the motion between them. nullopt unless the poses of its sensors in the rig
// are known.
[[nodiscard]] std::optional<Rigid3> RelativePoseBy(
    const MotionProblem& problem, const ImagePair& pair, int earlier_frame_idx,
    const Rigid3& later_from_earlier);

// The bound of epipolar errors of a pair.
[[nodiscard]] double ToleranceOf(const MotionProblem& problem,
                                 const ImagePair& pair);

// Compares two motions by all matches, since the matches of the static scene
// are outliers of the pairs that a vehicle dominates, but only between images
// of one sensor: matches of different sensors also show errors of their places
// in the rig. Matches with depth, which tell a motion along epipolar lines, and
// those without count apart.
[[nodiscard]] MotionExclusion ExclusionOf(const MotionProblem& problem,
                                          int earlier_frame_idx,
                                          int later_frame_idx,
                                          const Rigid3& motion1,
                                          const Rigid3& motion2);

// The covariance of the rotation vector and the direction of a relative pose
// with a baseline, by the residuals of its matches.
[[nodiscard]] PoseMatrix CovarianceOf(const MotionProblem& problem,
                                      const ImagePair& pair);

// The standard deviation of a keypoint, relative to the epipolar tolerance,
// which thus includes 95 % of normal errors.
inline constexpr double kKeypointNoise = 0.5;
// Errors of depths add to those of keypoints.
inline constexpr double kDepthErrorFactor = 2.0;

// The motion near `later_from_earlier` that matches with depth determine
// (rig_motions.h). nullopt if too few agree.
[[nodiscard]] std::optional<MeasuredMotion> RefineByDepths(
    const MotionProblem& problem, int earlier_frame_idx, int later_frame_idx,
    const Rigid3& later_from_earlier);

// Motions between two frames that correspondences with depth support, and those
// of pairs of equal sensors whose places in the rig are known, without
// distances.
[[nodiscard]] StepHypotheses FindHypothesesByDepths(
    const MotionProblem& problem, uint64_t random_seed, int earlier_frame_idx,
    int later_frame_idx);

// Per pair; nullopt if it is unknown.
using BaselineLengths = std::vector<std::optional<BaselineLength>>;

// Motions of pairs of equal sensors with these lengths of their baselines.
[[nodiscard]] StepHypotheses FindHypothesesByPairs(
    const MotionProblem& problem, const BaselineLengths& lengths,
    int earlier_frame_idx, int later_frame_idx);

}  // namespace mgsfm
