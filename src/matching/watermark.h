// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/matching/two_view_verification.h"

namespace mgsfm::internal {

// Whether matches, inliers of some geometry, are those of a frame or caption
// that was put into both images: enough of them lie at the borders of both
// images, and enough of these are shifted by the same vector, to max_error.
bool IsWatermark(const VerificationView& view1, const VerificationView& view2,
                 const std::vector<Match>& inliers,
                 const TwoViewGeometryOptions& options, Random* random);

}  // namespace mgsfm::internal
