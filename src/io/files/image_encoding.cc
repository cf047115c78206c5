// SPDX-License-Identifier: BSD-3-Clause
#include "files/image_encoding.h"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>

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

}  // namespace mgsfm
