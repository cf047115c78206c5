// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/ransac.h"

#include <cmath>

namespace mgsfm {

int RequiredNumTrials(const RansacOptions& options, double inlier_ratio,
                      int sample_size) {
  const double success = std::pow(inlier_ratio, sample_size);
  int num_trials = options.max_num_trials;
  if (success > 1.0 - 1e-12) {
    num_trials = 1;
  } else if (success > 1e-12) {
    const double trials =
        std::log(1.0 - options.confidence) / std::log1p(-success);
    num_trials =
        static_cast<int>(std::min<double>(num_trials, std::ceil(trials)));
  }
  return std::min(std::max(num_trials, options.min_num_trials),
                  options.max_num_trials);
}

}  // namespace mgsfm
