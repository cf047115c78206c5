// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "mgsfm/mapper/mapper.h"

namespace mgsfm {

// Throws Error if the folder has files, which may be masks of the user.
void CheckFixedRegionFolder(const std::filesystem::path& folder);

// Writes a mask per image of the sensors that have fixed regions, as
// ImageReader.mask_path reads them. A failure is a warning: the models are
// complete.
void WriteFixedRegionMasks(const std::filesystem::path& folder,
                           const Scene& scene, const MapperResult& result,
                           const Context& context);

}  // namespace mgsfm
