// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/io/models/scene_loading.h"

namespace mgsfm {

// If frames are made by time, no file has the times, and a name has none:
// writes the times in the EXIF tags of all images to `output_path` and sets it
// as the file with the times. Throws Error, naming the image, if one has no
// such tag.
void UseExifTimes(const std::string& image_path,
                  const std::vector<std::string>& names,
                  const std::filesystem::path& output_path,
                  const Context& context, SceneLoadingOptions* loading);

}  // namespace mgsfm
