// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace mgsfm {

// The verified matches that a model explains. Each match of two images with a
// pose counts for both, whether or not its pair was accepted.
struct KeptCount {
  size_t num_matches = 0;
  size_t num_kept = 0;  // agree with the poses of the model

  double Share() const {
    return num_matches > 0 ? static_cast<double>(num_kept) /
                                 static_cast<double>(num_matches)
                           : 1.0;
  }
  // Returns false without matches.
  bool IsMostlyKept() const { return 2 * num_kept > num_matches; }
};

struct KeptMatches {
  std::vector<KeptCount> sensors;  // per sensor
  std::vector<KeptCount> frames;   // per frame
  KeptCount total;
};

}  // namespace mgsfm
