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
// The rules of kPairRules compare pairs. They judge pairs of frames, so that
// the cameras of a rig vote together (docs/maths/pair_filtering.md).
//
// Two kinds of evidence serve several rules:
//
// - The skeletal graph (Snavely, Seitz, Szeliski, CVPR 2008; skeletal_graph.h).
//   Neighboring frames share most of what they see, duplicates share only the
//   duplicate. A sparse graph of the strongest pairs gives first rotations and
//   positions. In a sequence, neighbors in time come first.
// - Triplet support (Zach, Klopschitz, Pollefeys, CVPR 2010;
//   triplet_consistency.h). A match counts as support if a third image matches
//   both of its keypoints. Unrelated places have no such matches.
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
  // rules that compare pairs with the skeletal graph are off, too.
  bool use_skeletal_graph = true;
  // Select the skeletal graph by triplet-consistent matches first, instead of
  // by all matches.
  bool use_triplet_support = true;
  Option<bool> use_rotation_consistency{
      "use_rotation_consistency", true,
      "Reject pairs whose rotation is beyond the drift bound of the skeletal "
      "graph."};
  Option<bool> use_unsupported_bridges{
      "use_unsupported_bridges", true,
      "Reject a pair that alone connects two components if it has no triplet "
      "support and other pairs contradict it, and loop pairs of one place that "
      "alone connect two parts of a sequence."};
  Option<bool> use_motion_continuity{
      "use_motion_continuity", true,
      "Reject pairs of a sequence that show an object moving along with the "
      "rig, if matches show two mutually exclusive motions that persist in "
      "adjacent frames."};
  Option<bool> use_ambiguous_motion{
      "use_ambiguous_motion", true,
      "Reject pairs of neighbors in a sequence across a step whose competing "
      "motions are equally probable. Needs use_motion_continuity."};
  Option<bool> use_fixed_regions{
      "use_fixed_regions", true,
      "Drop the matches of image regions whose content moves along with the "
      "rig during the whole recording, such as a hull, a cabin or a tripod."};
  Option<bool> use_baseline_drift_bound{
      "use_baseline_drift_bound", true,
      "Ignore baselines beyond the drift bound of the skeletal graph when "
      "positions are initialized."};
  Option<bool> use_baseline_consistency{
      "use_baseline_consistency", true,
      "Reject pairs whose baseline contradicts the estimated positions."};

  // Minimum strength of a pair of frames, relative to the strongest pair of
  // either frame, to join the skeletal graph.
  double min_strength = 0.6;
  // Minimum strength of a pair to connect components of the skeletal graph,
  // relative to the strongest pair that leaves a component.
  double min_connecting_strength = 0.5;
  // Tolerance of pair rotations against the skeletal graph; the drift bound is
  // added to it.
  double max_rotation_error_deg = 3.0;
  // Drift bound of rotations in standard deviations of a random walk along the
  // skeletal graph.
  double rotation_drift_in_sigmas = 2.0;
  // Upper limit of the drift bound of rotations.
  double max_rotation_drift_deg = 17.0;
  // A bridge is rejected if the pairs that contradict it have at least this
  // multiple of its matches. In a sequence, only neighbors count.
  double min_share_against_bridge = 0.5;
  // Largest drift bound of positions, as a fraction of the path length. It is
  // tightened to a tenth while positions violate the skeletal graph.
  double max_baseline_drift = 0.2;
  // Baseline errors below this many typical depths of points never reject a
  // pair. The drift at a loop closure is small compared with the depths of
  // points.
  double max_baseline_error_in_depths = 0.25;
  // Baseline errors below this share of the longer of the measured and
  // estimated baseline never reject a pair. Relative motions of adjacent frames
  // have the same tolerance.
  double max_relative_baseline_error = 0.5;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(is_sequence, use_motion_continuity, use_ambiguous_motion,
          use_fixed_regions, use_rotation_consistency, use_unsupported_bridges,
          use_baseline_drift_bound, use_baseline_consistency);
  }
};

// Why a pair is not used: the first rule that it fails, or a missing estimate.
enum class RejectionReason {
  kNoRelativePose,  // verification found none
  kFixedRegion,
  kDiscontinuousMotion,
  kAmbiguousMotion,
  kUnknownSensorRotation,  // sensor_from_rig of one of its images is unknown
  kRotationBeyondDriftBound,
  kInconsistentRotation,  // contradicts the averaged rotations
  kUnsupportedBridge,
  kFrameWithoutRotation,  // no accepted pair connects one of its frames
  kDifferentComponents,   // its frames are in different components
  kBaselineBeyondDriftBound,
  kInconsistentBaseline,
};

template <>
struct EnumTable<RejectionReason> {
  static constexpr std::pair<std::string_view, RejectionReason> kNames[] = {
      {"no_relative_pose", RejectionReason::kNoRelativePose},
      {"fixed_region", RejectionReason::kFixedRegion},
      {"discontinuous_motion", RejectionReason::kDiscontinuousMotion},
      {"ambiguous_motion", RejectionReason::kAmbiguousMotion},
      {"unknown_sensor_rotation", RejectionReason::kUnknownSensorRotation},
      {"rotation_beyond_drift_bound",
       RejectionReason::kRotationBeyondDriftBound},
      {"inconsistent_rotation", RejectionReason::kInconsistentRotation},
      {"unsupported_bridge", RejectionReason::kUnsupportedBridge},
      {"frame_without_rotation", RejectionReason::kFrameWithoutRotation},
      {"different_components", RejectionReason::kDifferentComponents},
      {"baseline_beyond_drift_bound",
       RejectionReason::kBaselineBeyondDriftBound},
      {"inconsistent_baseline", RejectionReason::kInconsistentBaseline}};
};

// A rule rejects pairs for its own reason; the report counts them by reason.
struct PairRule {
  std::string_view name;
  std::string_view stage;  // the rule runs after this stage
  RejectionReason reason;
  Option<bool> PairFilteringOptions::*option;  // switches it off
  std::string_view rejects;
};

// All rules, in the order in which they run.
inline constexpr PairRule kPairRules[] = {
    {"fixed regions", "view graph", RejectionReason::kFixedRegion,
     &PairFilteringOptions::use_fixed_regions,
     "pairs without a relative pose but by matches of image regions that move "
     "along with the rig during the whole recording"},
    {"motion continuity", "rotation averaging",
     RejectionReason::kDiscontinuousMotion,
     &PairFilteringOptions::use_motion_continuity,
     "neighbors in a sequence that follow an object, where two motions "
     "exclude each other by their matches and persist in adjacent frames"},
    {"ambiguous motion", "rotation averaging",
     RejectionReason::kAmbiguousMotion,
     &PairFilteringOptions::use_ambiguous_motion,
     "neighbors in a sequence across a step whose rival motions are equally "
     "probable"},
    {"rotation drift bound", "rotation averaging of the skeletal graph",
     RejectionReason::kRotationBeyondDriftBound,
     &PairFilteringOptions::use_rotation_consistency,
     "pairs whose rotation differs from that of the skeletal graph by more "
     "than its drift explains"},
    {"unsupported bridges", "rotation averaging",
     RejectionReason::kUnsupportedBridge,
     &PairFilteringOptions::use_unsupported_bridges,
     "pairs that alone connect two components, without triplet support, and "
     "that other pairs contradict; loop pairs of one place that alone connect "
     "two parts of a sequence"},
    {"baseline drift bound", "L1 positions of the skeletal graph",
     RejectionReason::kBaselineBeyondDriftBound,
     &PairFilteringOptions::use_baseline_drift_bound,
     "pairs whose baseline differs from that of the skeletal graph by more "
     "than its drift explains, unless the final positions agree"},
    {"baseline consistency", "translation averaging",
     RejectionReason::kInconsistentBaseline,
     &PairFilteringOptions::use_baseline_consistency,
     "pairs whose baseline contradicts the positions in direction or "
     "length"}};

// Whether the rule with this reason is on.
[[nodiscard]] bool IsRuleOn(RejectionReason reason,
                            const PairFilteringOptions& options);

// Per pair of the view graph; nullopt: accepted.
using PairVerdicts = std::vector<std::optional<RejectionReason>>;

// Rejects the pairs that `is_rejected` names and that were accepted so far.
void Reject(const Mask& is_rejected, RejectionReason reason,
            PairVerdicts* verdicts);

struct RejectionCount {
  RejectionReason reason;
  size_t num_pairs = 0;
};

// All reasons in the order of the enum, including reasons without pairs.
// EnumName() returns the name of a reason in the report. Pairs in fixed regions
// are not in the view graph.
std::vector<RejectionCount> CountRejections(const PairVerdicts& verdicts,
                                            size_t num_of_fixed_regions = 0);

// Rejected pairs between two segments of neighboring frames: first_frame_idx1
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

// One line for the user: how many pairs between which frames, and the possible
// cause.
std::string DescribeRejectedGroup(const Scene& scene,
                                  const RejectedGroup& group);

}  // namespace mgsfm
