// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "base/random.h"

namespace mgsfm {

// The random streams, one per effect, so that enabling an effect does not
// change the others.
enum class Effect : uint64_t {
  kFacades,
  kStreetFurniture,
  kPoints,
  kDuplicates,
  kDetection,
  kPixelNoise,
  kClutter,
  kVehicles,
  kVehicleDetection,
  kMissingImages,
  kTriggerJitter,
  kMismatches,
  kEpipolarOutliers,
  kPairEstimates,
  kRandomPairs,
  kIsolatedPairs,
  kTextures,
  kConvoys,
  kWeakCuts,
  kWorlds,
  kNoiseTails,
};

// The seed of an effect, for use as Random(EffectSeed(...), item).
inline uint64_t EffectSeed(uint64_t seed, Effect effect) {
  return Random(seed, static_cast<uint64_t>(effect) + 1).NextBits();
}

inline Random RandomOf(uint64_t seed, Effect effect, uint64_t item = 0) {
  return Random(EffectSeed(seed, effect), item);
}

}  // namespace mgsfm
