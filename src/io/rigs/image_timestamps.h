// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "mgsfm/scene/scene.h"

namespace mgsfm {

// When images were taken: a line "image_name SECONDS" for each, '#' starting
// comments.

// Sets the times of all images. Throws Error, naming the line or image, for a
// file that cannot be read, a line that is none of these or has no finite
// number, an image that the scene does not have, or that is named twice, an
// image without time, and for frames of a rig whose times do not increase in
// the order of their names (in which numbers count as such).
void ReadImageTimestamps(const std::filesystem::path& path, Scene* scene);

// Images without time are left out.
void WriteImageTimestamps(const std::filesystem::path& path,
                          const Scene& scene);

}  // namespace mgsfm
