// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "base/random.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "moving_objects/motion_candidates.h"

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

// Fewer matches are no evidence of a motion of their own: three determine it,
// and each of the others agrees by chance with a probability of about 1e-3.
// docs/results/constants.md compares 5 to 15 matches of pairs on weak drives.
inline constexpr size_t kMinNumAgreeing = 8;

// The distance of a keypoint along its ray.
struct KeypointDepth {
  double distance = 0.0;
  double relative_sigma = 0.0;  // standard deviation, relative to the distance
};

// What pairs within frames tell about cameras and keypoints, in one unit of
// length.
struct FrameDepths {
  // Per sensor; nullopt if no pair within a frame connects it with the others.
  std::vector<std::optional<Rigid3>> cam_from_rig;
  // Per image and keypoint. Empty for images without.
  std::vector<std::vector<std::optional<KeypointDepth>>> keypoints;

  // nullptr if it is not known.
  const KeypointDepth* Find(int image_idx, size_t keypoint_idx) const {
    const auto& depths = keypoints[image_idx];
    return !depths.empty() && depths[keypoint_idx] ? &*depths[keypoint_idx]
                                                   : nullptr;
  }
};

// The angle of an error at the center of an image.
[[nodiscard]] double ErrorRad(const Scene& scene, int image_idx,
                              double error_px);

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
// those of verified correspondences with depth, and of outliers that agree.
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

}  // namespace mgsfm
