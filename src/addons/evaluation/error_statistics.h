// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {

// There must be an error.
ErrorStatistics SummarizeErrors(const std::vector<double>& errors);

// "m", or "units" of a ground truth that is not metric.
inline const char* LengthUnitName(const Evaluation& evaluation) {
  return evaluation.is_metric ? "m" : "units";
}

}  // namespace mgsfm
