// SPDX-License-Identifier: BSD-3-Clause
#include "io/files/image_codecs.h"

#include <opencv2/imgcodecs.hpp>

namespace mgsfm {
namespace {

cv::Mat Decode(const cv::Mat& file, int imread_flags) {
  return cv::imdecode(file, imread_flags);
}

bool Encode(const std::string& extension, const cv::Mat& image,
            std::vector<uint8_t>* file,
            const std::vector<int>& imwrite_parameters) {
  return cv::imencode(extension, image, *file, imwrite_parameters);
}

}  // namespace

extern "C" const ImageCodecs* MgsfmImageCodecs() {
  static constexpr ImageCodecs kCodecs = {Decode, Encode};
  return &kCodecs;
}

}  // namespace mgsfm
