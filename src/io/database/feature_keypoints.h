// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "io/database/database_rows.h"
#include "mgsfm/io/database/feature_database.h"

namespace mgsfm {

// Accepts 2, 4 (scale and orientation) or 6 columns, and completes the shape.
std::vector<FeatureKeypoint> MakeFeatureKeypoints(const KeypointBlob& blob);

}  // namespace mgsfm
