// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"

namespace mgsfm {

// Finds where a model is weak.
//
// A model is rigid only as far as observations tie its frames together. The
// maximum spanning tree of the frames, weighted by confirmed matches, defines
// the candidate cuts: removing one of its edges leaves two sides. A match is
// confirmed if both of its keypoints observe one point of the model. This stage
// counts for each cut
//
//   num_tracks   points observed on both sides,
//   num_ties     points whose position the frames of either side determine:
//                two of each side observe them, or all frames of a smaller
//                side,
//   confirmed    confirmed matches of used pairs between the sides,
//   against      matches of the largest group of rejected pairs between the
//                sides. The pairs of such a group agree on another trajectory;
//                isolated wrong pairs do not. A group counts against one cut of
//                the loop that it closes: the weakest one that can hide its
//                error, in a sequence the error of the relative motion there.
//
// The confidence of a cut is the fraction of matches that agree, reduced if few
// points cross:
//
//   confirmed / (confirmed + against) * num_tracks / (num_tracks + n0),
//
// The confidence of a frame is the minimum over the cuts between it and the
// core, the frame that no cut separates from most others. A cut is a weak seam
//
//   few ties       if few points tie its sides. Two frames also agree on a
//                  moving object; more frames agree on it only if it moves as
//                  the rig does.
//   jump           if neighbors in time on both sides contradict the motion of
//                  the rig. It is the weakest cut between them, and its
//                  confidence is 0.
//   refuted loops  the same, if a loop crosses the cut: of those between the
//                  neighbors, the weakest cut that a loop crosses.
//   one place      if no neighbors of a sequence connect its sides, but
//                  loops of one place, which can look alike. Its
//                  confidence is 0. Pairs most of whose matches are not
//                  confirmed do not count.
//   contradicted   if the share against it is large. Nothing counts against a
//                  cut across which frames confirm the motion of the rig.
//
// The uncertainty of a seam is the covariance of the relative pose of the two
// frames next to it, from the noise of the keypoints around them
// (bundle_adjustment/relative_covariance.h). It assumes that the points across
// the seam are correct.

struct ConfidenceOptions {
  // Report a cut as a weak seam if fewer points are observed by two frames on
  // either side, or by all frames of a smaller side.
  int min_num_ties = 5;
  // Report a cut as a weak seam if the largest group of rejected pairs across
  // it has more than this fraction of the matches.
  double max_share_against = 0.6;
};

enum class SeamReason {
  kFewTies,       // few points tie the sides together
  kContradicted,  // a group of rejected pairs disagrees with the model
  kJump,          // neighbors in time are not where the rig moved
  kRefutedLoops,  // the same, and loops join the sides
  kOnePlace,      // only loops of one place join the sides
};

template <>
struct EnumTable<SeamReason> {
  static constexpr std::pair<std::string_view, SeamReason> kNames[] = {
      {"few_ties", SeamReason::kFewTies},
      {"contradicted", SeamReason::kContradicted},
      {"jump", SeamReason::kJump},
      {"refuted_loops", SeamReason::kRefutedLoops},
      {"one_place", SeamReason::kOnePlace}};
};

struct Seam {
  SeamReason reason = SeamReason::kFewTies;
  // The frames on the side away from the core, ascending, and the two frames
  // next to the seam: one beyond it, one on the side of the core.
  std::vector<int> frame_idxs_beyond;
  int frame_idx_beyond = 0;
  int frame_idx_core = 0;
  int num_pairs = 0;   // used pairs that cross the seam
  int num_tracks = 0;  // points observed on both sides
  int num_ties = 0;    // points that two frames on either side observe
  int num_confirmed = 0;
  int num_against = 0;
  // Standard deviations of the position, in the unit of the model, and rotation
  // of frame_idx_beyond in frame_idx_core: the square roots of the sums of the
  // variances of the three axes. nullopt if the points do not determine them.
  std::optional<double> sigma_position;
  std::optional<double> sigma_rotation_deg;

  // The fields that are not per side.
  auto Fields() const {
    return Named("num_pairs", num_pairs, "num_tracks", num_tracks, "num_ties",
                 num_ties, "num_confirmed_matches", num_confirmed,
                 "num_matches_against", num_against, "sigma_position",
                 sigma_position, "sigma_rotation_deg", sigma_rotation_deg);
  }
};

struct Confidence {
  std::vector<Seam> seams;  // by ascending confidence
  // Per frame of the scene, in [0, 1]; nullopt for unregistered frames.
  std::vector<std::optional<double>> of_frame;
};

}  // namespace mgsfm
