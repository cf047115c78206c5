// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/base/random.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/matching/two_view_verification.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct RigVerificationOptions {
  bool rig_verification = true;
  int min_num_unit_inliers = 8;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("rig_verification", self.rig_verification, AnyValue(), "",
          "Where the poses of the cameras in the rig are known, verify all "
          "pairs of images of two frames together, too.");
    visit("min_num_unit_inliers", self.min_num_unit_inliers, AtLeast(5),
          "matches",
          "Pairs of images need only so many matches that agree with the "
          "motion that the other pairs of their two frames agree on.");
  }
};

// A pair of images of two rigid units, verified by itself.
struct UnitImagePair {
  VerificationView view1;  // of unit 1
  VerificationView view2;
  Rigid3 cam1_from_unit1;
  Rigid3 cam2_from_unit2;
  const std::vector<Match>* matches = nullptr;
  ImagePair single;  // VerifyPair of them
};

// Verifies all pairs of images of two frames of a known rig together: the
// motion of the rig (6 degrees of freedom) that the most matches of all pairs
// agree with. It counts if at least two pairs agree with it: each with
// min_num_unit_inliers and min_inlier_ratio of its matches, and all of them
// with min_num_inliers. Then a pair
//   that agrees gets the motion of the rig, and its matches that agree: a
//   motion
//     of its own is less certain, above all with few matches or little
//     parallax;
//   that is PANORAMIC, with half of its matches in agreement, stays as it is;
//   else is DEGENERATE: nothing, or another motion (of a vehicle, or of a place
//     that looks alike).
// If nothing counts, all stay as they are. nullopt for pairs that do.
// `unit2_from_unit1` is given where it is known, as for images of one frame;
// else it is estimated. Pairs whose intrinsics are not trusted, or that are
// watermarks, take no part.
std::vector<std::optional<ImagePair>> VerifyUnits(
    std::vector<UnitImagePair> pairs,
    const std::optional<Rigid3>& unit2_from_unit1,
    const TwoViewGeometryOptions& two_view, const RigVerificationOptions& rig,
    Random random);

}  // namespace mgsfm
