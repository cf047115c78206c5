// SPDX-License-Identifier: BSD-3-Clause
#include "image_run_summary.h"

#include <algorithm>

#include "base/format.h"

namespace mgsfm {

std::string Describe(const ImageRunSummary& summary) {
  const std::string rate =
      Formatted(" images in %.1f s, %.3g images/s; ", summary.seconds,
                static_cast<double>(summary.num_written) /
                    std::max(summary.seconds, 1e-9));
  return std::to_string(summary.num_written) + rate +
         std::to_string(summary.num_present) + " were already there";
}

}  // namespace mgsfm
