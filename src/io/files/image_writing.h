// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace mgsfm {

// Writes an image of 8 bits a channel, row by row from the upper left corner,
// red, green, blue, in the format that the extension names; the quality, from 1
// to 100, is of JPEG files. Throws Error if the file cannot be written.
void WriteColorImage(const std::filesystem::path& path, int width_px,
                     int height_px, const std::vector<uint8_t>& rgb,
                     int jpeg_quality = 95);

}  // namespace mgsfm
