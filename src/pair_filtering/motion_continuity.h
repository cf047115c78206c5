// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Pairs that match an object that moves along with the rig.
//
// A vehicle that keeps its distance fills some images for tens of frames. It
// passes verification, its pairs agree with each other, and they reach further
// than those of the world, which leaves the view. They state that the rig
// stands still. Counting pairs or matches cannot expose them; physics can: a
// rig does not stop from one frame to the next.
//
// Problem. Step k leads from frame k of a sequence to the next one. Its
// hypotheses are the baselines m_kh of the pairs of one sensor, more than one
// if the matches of a pair support different lengths. Over a choice of one
// hypothesis for each step, or none,
//
//   min sum_k -log(share_kh) + sum_k |v_k - v_k'|^2 / s_kk'^2
//       + kSkipCost * number of steps without a hypothesis,
//
// where share_kh is the share of the matches of the step that agree with m_kh,
// v = m / duration, k' is the previous step with a hypothesis, and s is
// kRelativeChange of the larger speed plus kMinChange of the median speed. The
// second term is at most kJumpCost: a sequence may have a real gap. A step far
// from any whose hypotheses disagree must have one: nothing questions them, and
// a camera in the hand is not smooth.
//
// Solver: dynamic programming, exact. Cost: linear in the steps.
//
// A pair contradicts the motion if none of its baselines agrees with the sum of
// the chosen steps up to max_relative_baseline_error of the longer one.
// Baselines between two sensors are corrected by their median offset.
//
// Limits. If the world is never seen next to an object, or not before and after
// it, the object is the world. Loop pairs are not judged.

// Per pair, the baselines between its cameras that its matches support, each
// with the number of matches; zero without parallax. Empty: unknown.
struct SupportedBaseline {
  Eigen::Vector3d baseline_in_world = Eigen::Vector3d::Zero();
  double num_matches = 0.0;
};
using SupportedBaselines = std::vector<std::vector<SupportedBaseline>>;

struct MotionConsistency {
  // Per pair: none of its baselines agrees with the motion.
  Mask pair_is_discontinuous;
  // Per pair: its baseline that agrees best, if one does.
  std::vector<std::optional<size_t>> agreeing;
};

MotionConsistency CheckMotion(const Scene& scene, const FramePairIndex& index,
                              const ViewGraph& view_graph,
                              const RotationEstimate& rotations,
                              const SupportedBaselines& baselines,
                              const PairFilteringOptions& options);

}  // namespace mgsfm
