// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "base/random.h"
#include "mgsfm/base/context.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "moving_objects/frame_depths.h"
#include "moving_objects/motion_candidates.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The motions of a rig between two frames that their matches support.
//
// Matches between two frames show the static scene, vehicles, and structures
// that look alike. The relative pose of one image pair cannot distinguish them:
// a vehicle ahead moves along the epipolar lines of the scene. Depths from
// pairs within a frame can. A keypoint with a known depth is a 3D point of one
// frame, and its match a ray of the other. Each motion is the generalized
// resection (geometry/absolute_pose.h) with the most inliers over the cameras
// of the rig,
//
//   max_(R,t) #{ m : angle(R p_m + t, f_m) <= max_error },
//
// where errors along the epipolar line are divided by the standard deviation of
// the depth (geometry/absolute_pose.h): distant points are numerous but
// uncertain, and would otherwise bias the motion. The search is repeated among
// the correspondences that no earlier motion explains. The first motion is not
// more credible than the others: a truck may have more keypoints than the
// street. But the truck hides the street behind it and is smaller, so the depth
// extent of its points is better evidence than their number.
// motion_continuity.h decides.
//
// Cost: RANSAC on a few hundred correspondences per motion.

// The matches of the image pairs of two frames.
struct FrameMatches {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const FrameDepths& depths;
  int earlier_frame_idx = 0;
  const std::vector<size_t>& pair_idxs;  // not empty
};

// Returns at most three motions, and none without depths. Their shares are
// those of the correspondences with depth.
[[nodiscard]] StepHypotheses FindRigMotions(const FrameMatches& matches,
                                            double max_error_px, Random random);

// The motion near `later_from_earlier` that the correspondences support, by
// robust least squares within a bound that shrinks to max_error_px. nullopt if
// too few agree.
[[nodiscard]] std::optional<MeasuredMotion> RefineRigMotion(
    const FrameMatches& matches, double max_error_px,
    const Rigid3& later_from_earlier);

// Compares a match with the relative pose of its images, in the unit of the
// depths: by the epipolar constraint and by those depths that are known, within
// their standard deviations. A depth also agrees if the intersection of both
// rays has the same depth up to a factor of 1.5: its standard deviation does
// not include errors of the motion and of sensor poses.
enum class MatchVerdict {
  kContradicts,
  kIsOnEpipolarLine,  // no depth is known: it may still move
  kAgrees,
};
[[nodiscard]] MatchVerdict CompareWithMotion(
    const Bearings& bearings, const FrameDepths& depths, const ImagePair& pair,
    const Match& match, const Rigid3& cam2_from_cam1, double tolerance_rad);

// Hypotheses for the motion of a rig between consecutive frames of a sequence.
//
// Matches of keypoints with depth determine a motion with its distance, but
// where a vehicle fills the overlapping views, few of them show the static
// scene. Single cameras that look elsewhere still see it. Their relative poses
// have the correct rotation and direction, but no distance.

// The measurements, and the settings that all steps share.
struct MotionProblem : MotionInput {
  const FramePairIndex& matches_index;
  const FrameDepths& depths;
  double max_error_px;
  double max_relative_baseline_error;
  // The median displacement of the rig that moves a keypoint by max_error_px.
  double noise_displacement = 0.0;

  FrameMatches MatchesOf(int earlier,
                         const FramePairIndex::FramePair& frames) const {
    return {scene, bearings, matches, depths, earlier, frames.pair_idxs};
  }
};

// The relative pose of an image pair of `earlier_frame_idx` and another frame,
// given the motion between the frames. nullopt unless the poses of both sensors
// in the rig are known.
[[nodiscard]] std::optional<Rigid3> RelativePoseBy(
    const MotionProblem& problem, const ImagePair& pair, int earlier_frame_idx,
    const Rigid3& later_from_earlier);

// The bound of epipolar errors of a pair.
[[nodiscard]] double ToleranceOf(const MotionProblem& problem,
                                 const ImagePair& pair);

// Compares two motions by all matches, because static matches are outliers of
// the pairs that a vehicle dominates. Only images of one sensor are compared:
// matches of different sensors also reveal errors of their poses in the rig.
// Matches with depth, which constrain motion along epipolar lines, and those
// without are counted separately.
[[nodiscard]] MotionExclusion ExclusionOf(const MotionProblem& problem,
                                          int earlier_frame_idx,
                                          int later_frame_idx,
                                          const Rigid3& motion1,
                                          const Rigid3& motion2);

// The covariance of the rotation vector and of the direction of a relative pose
// with a baseline, from the residuals of its matches.
[[nodiscard]] Eigen::Matrix<double, 6, 6> CovarianceOf(
    const MotionProblem& problem, const ImagePair& pair);

// The standard deviation of a keypoint relative to the epipolar tolerance,
// which thus includes 95 % of normal errors.
inline constexpr double kKeypointNoise = 0.5;
// Errors of depths are added to those of keypoints.
inline constexpr double kDepthErrorFactor = 2.0;

// The hypotheses of each step of each sequence.
using SequenceHypotheses = std::vector<std::vector<StepHypotheses>>;

// Motions that correspondences with depth support, and motions, without
// distances, of pairs of equal sensors whose poses in the rig are known.
[[nodiscard]] SequenceHypotheses FindHypothesesByDepths(
    const MotionProblem& problem, const Context& context);

struct BaselineLength {
  double value = 0.0;
  double sigma = 0.0;
};
// Per pair; nullopt if it is unknown.
using BaselineLengths = std::vector<std::optional<BaselineLength>>;

// Motions of pairs of equal sensors with these lengths of their baselines.
[[nodiscard]] SequenceHypotheses FindHypothesesByPairs(
    const MotionProblem& problem, const BaselineLengths& lengths,
    const Context& context);

}  // namespace mgsfm
