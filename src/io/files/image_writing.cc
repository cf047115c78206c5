// SPDX-License-Identifier: BSD-3-Clause
#include "files/image_writing.h"

#include <opencv2/imgcodecs.hpp>

#include "files/file_operations.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

std::string EncodeImage(const std::string& extension, const cv::Mat& image,
                        const std::vector<int>& imwrite_parameters) {
  std::vector<uint8_t> file;
  bool is_encoded = false;
  try {
    is_encoded = cv::imencode(extension, image, file, imwrite_parameters);
  } catch (const cv::Exception& exception) {
    RethrowLackOfMemory(exception);
  }
  if (!is_encoded) {
    throw Error("cannot be written as '" + extension + "'; use JPEG or PNG");
  }
  return {file.begin(), file.end()};
}

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
