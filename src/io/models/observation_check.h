// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "mgsfm/base/context.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {

// Compares poses, cameras and points of a model with its keypoints. Throws
// Error if more than a tenth of the points project elsewhere, and less than
// half as many with poses that are read in another convention: quaternions
// x, y, z, w, or poses world_from_cam. Warns if most project elsewhere.
void CheckObservations(const Model& model, const std::filesystem::path& folder,
                       const Context& context);

}  // namespace mgsfm
