// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "database/database_rows.h"
#include "mgsfm/database/feature_database.h"

namespace mgsfm {

// Accepts 2, 4 (scale and orientation) or 6 columns, and completes the shape.
std::vector<FeatureKeypoint> MakeFeatureKeypoints(const KeypointBlob& blob);

constexpr int kSiftColumns = 128;

// A row with rows, cols and data in the columns 1 to 3; `name` is that of the
// image. Throws Error unless the descriptors are SIFT's.
DescriptorMatrix DecodeDescriptors(const SqliteStatement& row,
                                   const std::string& path,
                                   const std::string& name);

}  // namespace mgsfm
