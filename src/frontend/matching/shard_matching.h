// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "matching/pair_selection.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// One share of the pairs. All pairs of two frames are in one share, because
// rig verification needs them together; shares have about the same number of
// pairs. Pairs of two blocks of some 50 images follow each other, so that the
// features of an image are read for many pairs.
ImagePairList PairsOfShare(const ImagePairList& pairs, const Scene& scene,
                           const Share& share);

// Matches and verifies one share of `pairs`, which must be the same in all
// processes, and writes the matches into a database of their own, a shard.
// `features` is open kReadOnly; pairs that it has already are not matched
// again. A share may be empty. Throws Error if `shard` is another shard or
// none.
PairMatchingSummary MatchShare(const FeatureDatabase& features,
                               const Scene& scene, const ImagePairList& pairs,
                               const Share& share,
                               const PairMatchingOptions& options,
                               FeatureDatabase* shard, const Context& context);

}  // namespace mgsfm
