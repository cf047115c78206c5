// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/models/scene_loading.h"

namespace mgsfm {

// Acts only if frames are formed by time, no file of times is given, and some
// image name contains no time. Writes the times in the EXIF tags of all images
// to `output_path` and makes it the file of times. Throws Error, naming the
// image, if an image has no such tag.
void UseExifTimes(const std::string& image_path,
                  const std::vector<std::string>& names,
                  const std::filesystem::path& output_path,
                  const Context& context, SceneLoadingOptions* loading);

}  // namespace mgsfm
