// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>

#include "matching/pair_selection.h"

namespace mgsfm::internal {

inline ImageIdxPair MakePair(int image_idx1, int image_idx2) {
  return {std::min(image_idx1, image_idx2), std::max(image_idx1, image_idx2)};
}

inline void SortUnique(ImagePairList* pairs) {
  std::sort(pairs->begin(), pairs->end());
  pairs->erase(std::unique(pairs->begin(), pairs->end()), pairs->end());
}

}  // namespace mgsfm::internal
