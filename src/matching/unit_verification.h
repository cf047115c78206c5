// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "matching/feature_cache.h"
#include "mgsfm/base/context.h"
#include "mgsfm/io/database/feature_database.h"
#include "mgsfm/matching/pair_matching.h"
#include "mgsfm/matching/pair_selection.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm::internal {

// VerifyPair for images of a database, with the seed of their names.
ImagePair VerifyImages(const Scene& scene, const ImageIdxPair& pair,
                       const ImageFeatures& features1,
                       const ImageFeatures& features2,
                       const std::vector<Match>& matches,
                       const TwoViewGeometryOptions& options,
                       const Context& context);

struct UnitVerificationSummary {
  size_t num_frame_pairs = 0;
  size_t num_changed = 0;   // pairs of images that get the motion of the rig
  size_t num_gained = 0;    // of them, not verified by themselves
  size_t num_rejected = 0;  // verified by themselves
};

// VerifyUnits for the frames of the pairs, all of which are matched, where the
// poses of their cameras in the rig are known and there are two pairs or more
// of two frames. Pairs that it changes are written over. Starts from the
// matches, so that it gives the same when it is run again, or was interrupted.
UnitVerificationSummary VerifyUnitsOfPairs(const ImagePairList& pairs,
                                           const Scene& scene,
                                           const PairMatchingOptions& options,
                                           FeatureDatabase* database,
                                           const Context& context);

}  // namespace mgsfm::internal
