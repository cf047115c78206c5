// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>

#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/view_graph.h"
#include "moving_objects/frame_depths.h"
#include "moving_objects/motion_continuity.h"
#include "moving_objects/motion_hypotheses.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Compares image pairs with the path of the rig (motion_continuity.h). A pair
// agrees if its rotation and baseline differ from those of the path by less
// than a tolerance plus 1.96 standard deviations.

// The relative pose that the path predicts for a pair.
struct ExpectedPair {
  size_t pair_idx = 0;
  Rigid3 cam2_from_cam1;
  // Covariance of the rotation vector and the translation, in the axes of
  // camera 2, due to the errors of the motion.
  PoseMatrix covariance = PoseMatrix::Zero();
};

// The bound of epipolar errors of the matches of an expected pair: the keypoint
// tolerance plus 1.96 standard deviations of the angle by which errors of the
// motion displace points at the median distance.
[[nodiscard]] double ToleranceOf(const MotionProblem& problem,
                                 const ExpectedPair& expected);

// The expected pair, given the motion of the rig from frame `frame_idx1` to the
// other frame of the pair. nullopt unless the poses of both sensors in the rig
// are known.
[[nodiscard]] std::optional<ExpectedPair> ExpectPair(
    const MotionProblem& problem, size_t pair_idx, int frame_idx1,
    const MeasuredMotion& rig2_from_rig1);

// Whether the relative pose of a pair agrees with the path. The length of its
// baseline is compared if it is known.
[[nodiscard]] bool AgreesWithPath(
    const MotionProblem& problem, const RigPath& path, const ImagePair& pair,
    const ExpectedPair& expected,
    const std::optional<BaselineLength>& length = std::nullopt);

// The motion between two frames, near the path, that their correspondences
// support. nullopt without one, or if image pairs support the path more: few
// correspondences with inaccurate depths can rotate the motion by a degree.
[[nodiscard]] std::optional<MeasuredMotion> RefineMotion(
    const MotionProblem& problem, const RigPath& path, int earlier, int later);

// Refines the steps that are interpolated, or doubtful and not part of a
// measured motion over several steps. Matches that agree with a refined step
// measure it.
[[nodiscard]] RigPath RefinePath(const MotionProblem& problem,
                                 const RigPath& path);

// Steps next to objects at which the motion of the rig is unknown
// (motion_continuity.h).
struct AmbiguousSteps {
  Mask pair_is_across;   // per pair of neighbors: its frames enclose a step
  Mask frame_is_beside;  // per frame: a step leads from or to it
};

// All false if more than a tenth of all steps are ambiguous: all motions are
// then doubtful. Cost: linear in the pairs and frames.
[[nodiscard]] AmbiguousSteps FindAmbiguousSteps(const FramePairIndex& index,
                                                const RigPath& path);

}  // namespace mgsfm
