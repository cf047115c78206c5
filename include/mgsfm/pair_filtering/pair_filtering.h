// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/fields.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Which image pairs can be trusted?
//
// Verification accepts a pair on its own matches. Duplicate structures, such as
// two equal facades, pass it: their matches agree with one relative pose, and
// many such pairs agree with each other. Robust averaging cannot outvote them.
// The rules below compare pairs instead; all judge pairs of frames, so that the
// cameras of a rig vote together.
//
// 1. Skeletal graph (Snavely, Seitz, Szeliski, CVPR 2008; skeletal_graph.h).
//    Neighboring frames share most of what they see, duplicates share only the
//    duplicate. A sparse graph of the strongest pairs gives first rotations and
//    positions. In a sequence, neighbors in time come first.
// 2. Triplet support (Zach, Klopschitz, Pollefeys, CVPR 2010;
//    triplet_consistency.h). A match counts as support if a third image matches
//    both of its keypoints. Unrelated places have no such matches.
// 3. Rotation consistency (rotation_consistency.h). A pair must agree with the
//    rotations of the skeleton up to a drift bound (drift_bound.h): drift grows
//    with the path length through the maximum spanning tree of the skeleton,
//    like its square root for rotations and proportionally for positions.
// 4. Unsupported bridges (unsupported_bridges.h). A pair that alone connects
//    two components is rejected if it has no triplet support and other pairs
//    contradict it. The components then stay apart.
// 5. Motion continuity (rig_motions.h, motion_continuity.h). Matches on an
//    object that moves along with the rig imply that it stands still. Where two
//    motions exclude each other by their matches, and persist in adjacent
//    frames, the smoothest choice exposes them.
// 6. Fixed regions (fixed_regions.h). Matches on an object that moves along
//    with the rig during the whole recording are dropped before all other
//    rules.
// 7. Baseline consistency (baseline_consistency.h). Direction and length of the
//    measured baseline must agree with the positions: first with those of the
//    skeleton up to the drift bound, at the end with the estimate. If all
//    neighbors contradict a step of a sequence (displaced_steps.h), rotations
//    that drift are corrected first.
//
// Rules 3 and 7 reject nothing if they would reject more than a third of the
// pairs they judge: then the skeleton is wrong, not the pairs.
//
// Known limits. Duplicates closer than the drift bound are accepted. If the
// neighbors of a place are missing, its duplicate can be the strongest pair.
// Without temporal order, objects that move along with the rig look like static
// structure.

// Whether frames are in the order in which they were captured, by their
// timestamps or names.
enum class SequenceMode {
  kAuto,  // yes if neighbors in that order share more matches than chance
          // explains
  kYes,
  kNo,
};

template <>
struct EnumTable<SequenceMode> {
  static constexpr std::pair<std::string_view, SequenceMode> kNames[] = {
      {"auto", SequenceMode::kAuto},
      {"yes", SequenceMode::kYes},
      {"no", SequenceMode::kNo}};
};

struct PairFilteringOptions {
  Option<SequenceMode> is_sequence{
      "is_sequence", SequenceMode::kAuto,
      "State whether timestamps or names give the temporal order of frames. If "
      "they do, pairs of neighbors decide how the trajectory continues, not "
      "loop pairs."};
  // Start rotations and positions from a skeletal graph. Without it, the two
  // rules that compare pairs with the skeleton are off, too.
  bool use_skeletal_graph = true;
  // Select the skeletal graph by triplet-consistent matches first, instead of
  // by all matches.
  bool use_triplet_support = true;
  // Reject pairs whose rotation is beyond the drift bound of the skeletal
  // graph.
  bool use_rotation_consistency = true;
  // Reject a pair that alone connects two components if it has no triplet
  // support and other pairs contradict it.
  bool use_unsupported_bridges = true;
  Option<bool> use_motion_continuity{
      "use_motion_continuity", true,
      "Reject pairs of a sequence that show an object moving along with the "
      "rig, where two motions exclude each other by their matches and persist "
      "in adjacent frames."};
  Option<bool> use_fixed_regions{
      "use_fixed_regions", true,
      "Drop the matches of image regions whose content moves along with the "
      "rig during the whole recording, such as a hull, a cabin or a tripod."};
  // Ignore baselines beyond the drift bound of the skeletal graph when
  // positions are initialized.
  bool use_baseline_drift_bound = true;
  // Reject pairs whose baseline contradicts the estimated positions.
  bool use_baseline_consistency = true;

  // Strength of a pair of frames, relative to the strongest pair of either
  // frame, above which it joins the skeletal graph.
  double min_strength = 0.6;
  // Strength, relative to the strongest pair that leaves a component, from
  // which a pair connects components of the skeletal graph.
  double min_connecting_strength = 0.5;
  // Tolerance of pair rotations against those of the skeletal graph; the drift
  // bound is added to it.
  double max_rotation_error_deg = 3.0;
  // Drift bound of rotations in standard deviations of a random walk along the
  // skeletal graph.
  double rotation_drift_in_sigmas = 2.0;
  // Upper limit of the drift bound of rotations.
  double max_rotation_drift_deg = 17.0;
  // A bridge is rejected if the pairs that contradict it have at least this
  // multiple of its matches.
  double min_share_against_bridge = 0.5;
  // Largest drift bound of positions, as a share of the path length. It is
  // tightened to a tenth while positions violate the skeletal graph.
  double max_baseline_drift = 0.2;
  // Baseline errors below this many typical depths of points never reject a
  // pair. Loop closures miss by the drift, which is small compared with what
  // the cameras see.
  double max_baseline_error_in_depths = 0.25;
  // Baseline errors below this share of the longer of the measured and
  // estimated baseline never reject a pair. Steps of a sequence have the same
  // tolerance.
  double max_relative_baseline_error = 0.5;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(is_sequence, use_motion_continuity, use_fixed_regions);
  }
};

// Why a pair is not used. A pair has the reason of the first rule it fails.
enum class RejectionReason {
  kNoRelativePose,            // verification found none
  kDiscontinuousMotion,       // rule 5
  kUnknownSensorRotation,     // sensor_from_rig of one of its images is unknown
  kRotationBeyondDriftBound,  // rule 3
  kInconsistentRotation,      // contradicts the estimated rotations
  kUnsupportedBridge,         // rule 4
  kFrameWithoutRotation,      // no accepted pair connects one of its frames
  kDifferentComponents,       // its frames are in different components
  kNoBaseline,                // no translation explains its matches
  kInconsistentBaseline,      // rule 7
};

template <>
struct EnumTable<RejectionReason> {
  static constexpr std::pair<std::string_view, RejectionReason> kNames[] = {
      {"no_relative_pose", RejectionReason::kNoRelativePose},
      {"discontinuous_motion", RejectionReason::kDiscontinuousMotion},
      {"unknown_sensor_rotation", RejectionReason::kUnknownSensorRotation},
      {"rotation_beyond_drift_bound",
       RejectionReason::kRotationBeyondDriftBound},
      {"inconsistent_rotation", RejectionReason::kInconsistentRotation},
      {"unsupported_bridge", RejectionReason::kUnsupportedBridge},
      {"frame_without_rotation", RejectionReason::kFrameWithoutRotation},
      {"different_components", RejectionReason::kDifferentComponents},
      {"no_baseline", RejectionReason::kNoBaseline},
      {"inconsistent_baseline", RejectionReason::kInconsistentBaseline}};
};

// Per pair of the view graph; nullopt: accepted.
using PairVerdicts = std::vector<std::optional<RejectionReason>>;

// Rejects the pairs that `is_rejected` names and that were accepted so far.
void Reject(const Mask& is_rejected, RejectionReason reason,
            PairVerdicts* verdicts);

struct RejectionCount {
  RejectionReason reason;
  size_t num_pairs = 0;
};

// All reasons in the order of the enum, also those without any pair.
// EnumName() gives the name of a reason in the report.
std::vector<RejectionCount> CountRejections(const PairVerdicts& verdicts);

// Rejected pairs between two stretches of neighboring frames: first_frame_idx1
// to last_frame_idx1 and first_frame_idx2 to last_frame_idx2. A large group
// indicates duplicate structures.
struct RejectedGroup {
  std::vector<size_t> pair_idxs;
  int first_frame_idx1 = 0;
  int last_frame_idx1 = 0;
  int first_frame_idx2 = 0;
  int last_frame_idx2 = 0;

  auto Fields() const {
    using Range = std::vector<int>;
    return Named(
        "num_pairs", pair_idxs.size(), "frames1",
        As<Item::kFrameName>(Range{first_frame_idx1, last_frame_idx1}),
        "frames2",
        As<Item::kFrameName>(Range{first_frame_idx2, last_frame_idx2}));
  }
};

// One line for the user: how many pairs between which frames, and what they may
// show.
std::string DescribeRejectedGroup(const Scene& scene,
                                  const RejectedGroup& group);

}  // namespace mgsfm
