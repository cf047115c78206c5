// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "base/random.h"

namespace mgsfm {

// Common parts of the RANSAC estimators.

struct RansacOptions {
  double max_error_rad = 2e-3;
  double confidence = 0.9999;  // probability of an outlier-free sample
  int min_num_trials = 20;
  int max_num_trials = 5000;
};

// The number of trials n for the confidence of drawing a sample of
// `sample_size` inliers, 1 - (1 - inlier_ratio^sample_size)^n >= confidence,
// within the limits of the options.
int RequiredNumTrials(const RansacOptions& options, double inlier_ratio,
                      int sample_size);

// Distinct indices below `size`, which must be at least kSize.
template <size_t kSize>
std::array<size_t, kSize> DrawSample(size_t size, Random* random) {
  std::array<size_t, kSize> sample;
  for (size_t i = 0; i < kSize;) {
    sample[i] = random->Index(static_cast<uint32_t>(size));
    const auto end = sample.begin() + i;
    if (std::find(sample.begin(), end, sample[i]) == end) ++i;
  }
  return sample;
}

}  // namespace mgsfm
