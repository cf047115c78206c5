// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/eval/evaluation.h"

namespace mgsfm {

// There must be an error.
ErrorStatistics SummarizeErrors(const std::vector<double>& errors);

}  // namespace mgsfm
