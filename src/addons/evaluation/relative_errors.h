// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {

// Both compare the relative poses of reference images, in their order, after
// the lengths of the model are multiplied by `scale`. nullopt if there is none
// to compare.
std::optional<SegmentErrors> EvaluateSegments(
    const std::vector<ImagePoses>& images, double scale);
std::optional<StepErrors> EvaluateSteps(const std::vector<ImagePoses>& images,
                                        double scale);

}  // namespace mgsfm
