// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace mgsfm {

// Ids in a COLMAP database are in [0, kMaxNumIds).
constexpr int64_t kMaxNumIds = 2147483647;

// The id of the pair of two images: id1 < id2.
inline int64_t PairId(int64_t id1, int64_t id2) {
  return kMaxNumIds * id1 + id2;
}

}  // namespace mgsfm
