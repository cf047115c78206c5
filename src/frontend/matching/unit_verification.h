// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "matching/feature_cache.h"
#include "matching/pair_selection.h"
#include "matching/scene_pairs.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm::internal {

// VerifyPair for two images of a database, seeded by their names.
ImagePair VerifyImages(const Scene& scene, const ImageIdxPair& pair,
                       const ImageFeatures& features1,
                       const ImageFeatures& features2,
                       const std::vector<Match>& matches,
                       const TwoViewGeometryOptions& options,
                       const Context& context);

struct UnitVerificationSummary {
  size_t num_frame_pairs = 0;
  size_t num_changed = 0;   // image pairs that take the rig motion
  size_t num_gained = 0;    // of these, not verified by VerifyPair
  size_t num_rejected = 0;  // verified by VerifyPair, but not by the rig
};

// Runs VerifyUnits on all pairs of frames with known rig extrinsics and at
// least two matched image pairs, and overwrites the two-view geometries that
// change. Starts from the matches, so that running it again, or after an
// interruption, gives the same result.
UnitVerificationSummary VerifyUnitsOfPairs(const ImagePairList& pairs,
                                           const Scene& scene,
                                           const PairMatchingOptions& options,
                                           const MatchDatabases& databases,
                                           const Context& context);

}  // namespace mgsfm::internal
