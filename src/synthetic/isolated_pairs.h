// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "synthetic/pair_making.h"

namespace mgsfm {

// Verified pairs of images that have nothing in common and are not in `plans`,
// up to `num_pairs`. Their matches follow a plausible motion; they join
// features that happen to fit and, for the rest, new ones, which are appended.
// `maker` refers to the same photographs.
std::vector<MadePair> MakeIsolatedPairs(const SimulationOptions& options,
                                        const std::vector<SimulatedCamera>& rig,
                                        const Detector& detector,
                                        const PairMaker& maker,
                                        const std::vector<PairPlan>& plans,
                                        int num_pairs, const Context& context,
                                        Photographs* photographs);

}  // namespace mgsfm
