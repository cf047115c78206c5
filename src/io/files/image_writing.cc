// SPDX-License-Identifier: BSD-3-Clause
#include "files/image_writing.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "files/image_encoding.h"
#include "files/output_file.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

void WriteColorImage(const std::filesystem::path& path, int width_px,
                     int height_px, const std::vector<uint8_t>& rgb,
                     int jpeg_quality) {
  MGSFM_CHECK_EQ(rgb.size(), 3 * static_cast<size_t>(width_px) * height_px);
  cv::Mat bgr(height_px, width_px, CV_8UC3);
  for (size_t i = 0; i < rgb.size(); i += 3) {
    for (size_t j = 0; j < 3; ++j) bgr.data[i + j] = rgb[i + 2 - j];
  }
  std::string file;
  try {
    file = EncodeImage(path.extension().string(), bgr,
                       {cv::IMWRITE_JPEG_QUALITY, jpeg_quality});
  } catch (const Error& error) {
    throw Error("image '" + path.string() + "' " + error.what());
  }
  WriteFile(path, file);
}

}  // namespace mgsfm
