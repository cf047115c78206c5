// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "simulator/pair_making.h"

namespace mgsfm {

// Verified pairs of images of unrelated places that are not in `plans`, at most
// `num_pairs`. Their matches are consistent with a plausible motion. They
// connect features that fit by chance, and new features appended to the images.
// `maker` must refer to the same photographs.
std::vector<MadePair> MakeIsolatedPairs(const SimulationOptions& options,
                                        const std::vector<SimulatedCamera>& rig,
                                        const Detector& detector,
                                        const PairMaker& maker,
                                        const std::vector<PairPlan>& plans,
                                        int num_pairs, const Context& context,
                                        Photographs* photographs);

}  // namespace mgsfm
