// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace mgsfm {

// Writes an 8-bit RGB image, stored row by row from the upper left corner, in
// the format of the extension. `jpeg_quality` is in [1, 100]. Throws Error if
// the file cannot be written.
void WriteColorImage(const std::filesystem::path& path, int width_px,
                     int height_px, const std::vector<uint8_t>& rgb,
                     int jpeg_quality = 95);

}  // namespace mgsfm
