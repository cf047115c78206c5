// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Throws Error if the folder has files, which may be the user's masks.
void CheckFixedRegionFolder(const std::filesystem::path& folder);

// Writes masks of the sensors that have fixed regions: one per folder of images
// for ImageReader.camera_mask_path if the images of each sensor have folders of
// their own, or else one per image for ImageReader.mask_path. The log names the
// option. A failure is a warning: the models are complete.
void WriteFixedRegionMasks(const std::filesystem::path& folder,
                           const Scene& scene,
                           const std::vector<FixedRegion>& regions,
                           const Context& context);

}  // namespace mgsfm
