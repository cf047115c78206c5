// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/rigid3.h"
#include "moving_objects/motion_candidates.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The motion of a rig along a sequence, among hypotheses.
//
// A vehicle that stays at a constant distance fills some images for tens of
// frames. Its pairs pass verification, agree with each other, and reach further
// than those of the static scene, which leaves the view. They state that the
// rig stands still. Counting pairs or matches cannot expose them; physics can:
// a rig does not stop or turn from one frame to the next.
//
// Problem. Step k leads from frame k of a sequence to the next one. Its
// hypotheses are rigid motions with the share of the matches that agree. Over a
// choice of one hypothesis h for each step, or none,
//
//   min sum_k (-w log(share_kh) + N_kh + D_kh) + sum_k C(k', k)
//       + kSkipCost * number of steps without a hypothesis,
//   C = a log(1 + (|v_k - v_k'|^2 / s_v^2 + |w_k - w_k'|^2 / s_w^2) / a),
//
// with the velocity v and the angular velocity w in the frame of the rig, the
// previous step k' with a hypothesis, and scales s of kRelativeChange of the
// larger speed plus a minimum. The distance of a hypothesis without one is a
// further unknown. N is the cost of an object: a vehicle hides the static scene
// behind it, so its points are nearer and less spread. With the reach r_h of
// the points that agree with hypothesis h only, N = u log(max_g r_g / r_h),
// over the other motions g with enough matches. D is what an unknown distance
// costs: a constant, and a loss of its difference from the measured distances
// that agree with its direction. A sequence may have a real jump, hence the
// Cauchy loss, a = kLossScale. A step far from any whose hypotheses disagree
// must have one: nothing questions it, and a camera in the hand is not smooth.
// If such a hypothesis has no distance, it continues with the velocity closest
// to the previous one.
//
// Solver: dynamic programming over the hypotheses and a range of distances,
// close enough together (motion_search.h). Where no hypothesis is chosen,
// motions over several steps take part in a second choice.
// Unknown distances of the solution are interpolated between known ones. Cost:
// linear in the steps.
//
// Ambiguity. A rig that starts beside a vehicle which starts, too, moves as
// smoothly relative to the vehicle as relative to the street. Where the cost
// rises by less than kMinMargin with another motion, for several steps, the
// motion is unknown.
//
// Limits. If the static scene is never seen next to an object, or not before
// and after it, the object is the scene.

// The pose of a rig along its motion. Frames of different segments, or of none,
// are not comparable.
struct RigPath {
  struct Place {
    int stretch = 0;
    // Number of unknown steps near objects since the start of the sequence.
    int num_ambiguous = 0;
    Rigid3 rig_from_start = {};
    // Sums over the steps since the start, in its axes: the difference of two
    // poses has the covariances of the steps between them.
    Eigen::Matrix3d rotation_covariance = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d center_covariance = Eigen::Matrix3d::Zero();

    void Move(const MeasuredMotion& step);
  };
  std::vector<std::optional<Place>> of_frame;
  // Per frame: whether hypotheses disagree about a step from or to it, or about
  // one within seven steps.
  Mask is_doubtful;
  // Per frame: the step to it has no hypothesis that was chosen, or one without
  // a distance.
  Mask is_interpolated;
  // Per frame: chosen hypotheses, or matches, measure the motion between frames
  // of one group. Groups of all sequences differ.
  std::vector<int> group;
  // Per frame: the step to it is part of a chosen motion over several steps.
  Mask is_in_long_motion;
  MotionNoise noise;  // the largest of all sequences

  bool IsComparable(int frame_idx1, int frame_idx2) const {
    const auto& place1 = of_frame[frame_idx1];
    const auto& place2 = of_frame[frame_idx2];
    return place1 && place2 && place1->stretch == place2->stretch;
  }
  // Whether an unknown step near objects lies between two frames of a sequence.
  bool IsAmbiguousBetween(int frame_idx1, int frame_idx2) const {
    const auto& place1 = of_frame[frame_idx1];
    const auto& place2 = of_frame[frame_idx2];
    return place1 && place2 && place1->num_ambiguous != place2->num_ambiguous;
  }
  // later_from_earlier of two comparable frames.
  Rigid3 Between(int earlier, int later) const {
    return of_frame[later]->rig_from_start *
           of_frame[earlier]->rig_from_start.Inverse();
  }
  [[nodiscard]] MeasuredMotion MeasuredBetween(int earlier, int later) const;
};

// Steps without a choice have the mean velocity of their neighbors. A new
// segment begins after more than seven such steps, or fewer that take as long,
// after ambiguous steps, and after such a step far from competing hypotheses:
// nothing suggests that its true motion was outvoted.
[[nodiscard]] RigPath FindRigPath(const TemporalOrder& order, int num_frames,
                                  const MotionEvidence& evidence,
                                  int num_threads);

}  // namespace mgsfm
