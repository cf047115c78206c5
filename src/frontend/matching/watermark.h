// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "matching/two_view_verification.h"

namespace mgsfm::internal {

// Whether the inliers of a two-view geometry are those of a watermark, that is,
// a frame or caption inserted into both images: at least
// watermark_min_inlier_ratio of them lie at the border of both images and share
// one translation, up to max_error.
bool IsWatermark(const VerificationView& view1, const VerificationView& view2,
                 const std::vector<Match>& inliers,
                 const TwoViewGeometryOptions& options, Random* random);

}  // namespace mgsfm::internal
