// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace mgsfm {

// The bytes of an image file in the format of the extension (".jpg").
// `imwrite_parameters` are those of cv::imwrite. Throws Error; its message
// continues the file name: "cannot be written as ...".
std::string EncodeImage(const std::string& extension, const cv::Mat& image,
                        const std::vector<int>& imwrite_parameters = {});

// Writes an 8-bit RGB image, stored row by row from the upper left corner, in
// the format of the extension. `jpeg_quality` is in [1, 100]. Throws Error if
// the file cannot be written.
void WriteColorImage(const std::filesystem::path& path, int width_px,
                     int height_px, const std::vector<uint8_t>& rgb,
                     int jpeg_quality = 95);

}  // namespace mgsfm
