// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// The images and matches of an ImagePair, without geometry, to save memory.
struct PairMatches {
  int image_idx1 = 0;  // < image_idx2
  int image_idx2 = 0;
  std::vector<Match> matches;
};

}  // namespace mgsfm
