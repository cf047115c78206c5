// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "base/random.h"
#include "matching/pair_selection.h"
#include "matching/scene_pairs.h"
#include "matching/two_view_verification.h"
#include "mgsfm/base/context.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// One image pair of two rigid units (frames).
struct UnitImagePair {
  VerificationView view1;  // of unit 1
  VerificationView view2;
  Rigid3 cam1_from_unit1;
  Rigid3 cam2_from_unit2;
  const std::vector<Match>* matches = nullptr;
  ImagePair single;  // result of VerifyPair
};

// Verifies all image pairs of two frames of a calibrated rig jointly, by the
// rig motion unit2_from_unit1 (6 degrees of freedom) with the most inliers over
// all pairs (geometry/generalized_pose.h).
//
// An image pair supports the motion if at least min_num_unit_inliers and
// min_inlier_ratio of its matches are inliers. The motion is accepted if at
// least two pairs support it, with min_num_inliers inliers in total. Then
//   - a supporting pair becomes CALIBRATED, with the relative pose of the rig
//     motion and its inliers: a motion estimated from one pair alone is less
//     certain, especially with few matches or little parallax;
//   - a PANORAMIC pair of which at least half the inliers agree is unchanged;
//   - any other pair becomes DEGENERATE: its own motion contradicts the rig, as
//     for a moving object or a duplicate structure.
// If the motion is not accepted, all pairs are unchanged.
//
// Returns the new two-view geometry of each pair, nullopt if it is unchanged.
// `unit2_from_unit1` is the known motion, such as the identity for images of
// one frame; nullopt to estimate it. Pairs without prior focal lengths and
// WATERMARK pairs are ignored and unchanged.
[[nodiscard]] std::vector<std::optional<ImagePair>> VerifyUnits(
    const std::vector<UnitImagePair>& pairs,
    const std::optional<Rigid3>& unit2_from_unit1,
    const TwoViewGeometryOptions& two_view, const RigVerificationOptions& rig,
    Random random);

// VerifyPair for two images of a database, seeded by their names.
ImagePair VerifyImages(const Scene& scene, const ImageIdxPair& pair,
                       const ImageFeatures& features1,
                       const ImageFeatures& features2,
                       const std::vector<Match>& matches,
                       const TwoViewGeometryOptions& options,
                       const Context& context);

struct FramePairSummary {
  size_t num_frame_pairs = 0;
  size_t num_changed = 0;   // image pairs that take the rig motion
  size_t num_gained = 0;    // of these, not verified by VerifyPair
  size_t num_rejected = 0;  // verified by VerifyPair, but not by the rig
};

// Runs VerifyUnits on all pairs of frames with known rig extrinsics and at
// least two matched image pairs, and overwrites the two-view geometries that
// change. Starts from the matches, so that repeated or interrupted runs give
// the same result.
FramePairSummary VerifyUnitsOfPairs(const ImagePairList& pairs,
                                    const Scene& scene,
                                    const PairMatchingOptions& options,
                                    const MatchDatabases& databases,
                                    const Context& context);

}  // namespace mgsfm
