// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "report/benchmark_run.h"

namespace mgsfm {

struct CurveOptions {
  std::string title;
  std::string setting;    // option of the simulation along the x axis
  std::string x_label;    // with unit
  double x_factor = 1.0;  // from the option to that unit
};

// As SVG, against a setting of the simulation: above, on a logarithmic scale,
// the mean position error of the mapper, and dashed that of the full oracle;
// below the share of images that the mapper registered. One colour a rig. Runs
// that differ in the seed only count by their median.
std::string CurvesToSvg(const std::vector<BenchmarkRun>& runs,
                        const CurveOptions& options);

}  // namespace mgsfm
