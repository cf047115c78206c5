// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/rigid3.h"
#include "pair_filtering/temporal_order.h"

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
// kDistanceSpacing apart (motion_search.h). Unknown distances of the solution
// are interpolated between known ones. Cost: linear in the steps.
//
// Ambiguity. A rig that starts beside a vehicle which starts, too, moves as
// smoothly relative to the vehicle as relative to the street. Where the cost
// rises by less than kMinMargin with another motion, for several steps, the
// motion is unknown.
//
// Limits. If the static scene is never seen next to an object, or not before
// and after it, the object is the scene.

// A motion, with the covariances of its rotation vector, in the later rig
// frame, and of its center, in the earlier one.
struct MeasuredMotion {
  Rigid3 later_from_earlier;
  Eigen::Matrix3d rotation_covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d center_covariance = Eigen::Matrix3d::Zero();

  [[nodiscard]] MeasuredMotion Inverse() const;
};

struct MotionHypothesis {
  Rigid3 later_from_earlier;  // rig frames
  // Shares of the matches of the step: those that agree, and those that agree
  // with no earlier hypothesis.
  double share = 1.0;
  double own_share = 1.0;
  // One camera does not measure how far it moved: any non-negative multiple of
  // this vector, in the earlier rig frame, may be added to the center of
  // `later_from_earlier`. Zero: the camera saw no parallax.
  std::optional<Eigen::Vector3d> free_direction = {};
  // Distance and spread of the points that agree with this hypothesis only
  // (rig_motions.h), if they are known.
  std::optional<double> reach = {};
  // Covariances, by the noise of keypoints and depths: of the rotation vector,
  // in the later rig frame, and of the center, in the earlier one. The latter
  // is that of `free_direction`, if there is one.
  Eigen::Matrix3d rotation_covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d center_covariance = Eigen::Matrix3d::Zero();

  // The motion of all multiples whose center is closest to `center`.
  [[nodiscard]] MeasuredMotion ClosestTo(const Eigen::Vector3d& center) const;
};
using StepHypotheses = std::vector<MotionHypothesis>;

// The motion of a pose (R, t) of the later frame, or of the earlier one if it
// is reversed, with the covariance of (w, dt): Exp(w) R, t + dt.
[[nodiscard]] MeasuredMotion MeasuredMotionOf(
    const Rigid3& pose, const Eigen::Matrix<double, 6, 6>& covariance,
    bool is_reversed);

// What the steps of one recording tell about their own errors and changes. A
// wrong focal length, a rig that is not known well, or cameras that trigger
// apart let depths and image pairs, or pairs of different cameras, disagree
// about every step: then a disagreement is no evidence for an object. Low
// quantiles over all steps, so that objects in most of them have no influence.
// The covariances of the hypotheses are not part of them.
struct MotionNoise {
  double median_step = 0.0;
  // Standard deviations, per axis, of the difference of two measurements of one
  // step: of its rotation, and of its center relative to its length.
  double rotation_rad = 0.0;
  double relative_center = 0.0;
  // And of the change of the velocity from one step to the next.
  double turn_change_rad = 0.0;
  double linear_change = 0.0;
};

// Where a rig is along its motion. Frames of different stretches, or of none,
// are not comparable.
struct RigPath {
  struct Place {
    int stretch = 0;
    // Unknown steps near objects between the start of the sequence and here.
    int num_ambiguous = 0;
    Rigid3 rig_from_start = {};
    // Sums over the steps from the start, in its axes: the difference of two
    // places has the covariances of the steps between them.
    Eigen::Matrix3d rotation_covariance = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d center_covariance = Eigen::Matrix3d::Zero();

    void Move(const MeasuredMotion& step);
  };
  std::vector<std::optional<Place>> of_frame;
  // Per frame: hypotheses disagree about a step from or to it.
  Mask is_contested;
  // Per frame: the step to it has no hypothesis that was chosen, or one without
  // a distance.
  Mask is_interpolated;
  // Per frame: the steps before it in its sequence without a hypothesis that
  // was chosen.
  std::vector<int> num_unknown;
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
  // Whether two motions agree within tolerance.
  bool AreSimilar(const Rigid3& a, const Rigid3& b) const;
  // Of the difference of two measurements, beyond that of precise ones.
  double RotationToleranceRad() const { return 2.0 * noise.rotation_rad; }
  // later_from_earlier of comparable frames.
  Rigid3 Between(int earlier, int later) const {
    return of_frame[later]->rig_from_start *
           of_frame[earlier]->rig_from_start.Inverse();
  }
  [[nodiscard]] MeasuredMotion MeasuredBetween(int earlier, int later) const;
};

// The evidence of the matches of two frames that two motions are not those of
// one rigid scene. A motion that is measured badly, for lack of parallax or by
// a wrong calibration, still agrees with the matches of the true one; that of
// an object does not.
struct MotionExclusion {
  // The smaller of the shares that agree with one of the motions only, of the
  // matches that agree with either.
  double share = 0.0;
  // The share that contradicts the second motion, of the matches that agree
  // with the first one.
  double unexplained = 0.0;
  // The number of matches that agree with the second motion only, less the
  // number that agree with the first one only.
  std::ptrdiff_t balance = 0;
};
// Motions exclude each other from this share on. A rival also explains as many
// matches, and others than those before.
inline constexpr double kContestingShare = 0.15;
using MotionComparison = std::function<MotionExclusion(
    int earlier_frame_idx, int later_frame_idx, const Rigid3& motion1,
    const Rigid3& motion2)>;

// `hypotheses` has one item per step of each sequence of the order. Without
// `compare`, motions that differ exclude each other. Steps
// without a choice have the mean velocity of their neighbors. More than seven
// of them, or fewer that take as long, begin another stretch, and so do
// ambiguous ones and one far from any whose hypotheses disagree: nothing
// suggests that its true motion was outvoted.
[[nodiscard]] RigPath FindRigPath(
    const TemporalOrder& order, int num_frames,
    const std::vector<std::vector<StepHypotheses>>& hypotheses,
    const MotionComparison& compare = {});

}  // namespace mgsfm
