// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace mgsfm {

// The image codecs of OpenCV: cv::imdecode and cv::imencode.
struct ImageCodecs {
  cv::Mat (*decode)(const cv::Mat& file, int imread_flags);
  bool (*encode)(const std::string& extension, const cv::Mat& image,
                 std::vector<uint8_t>* file,
                 const std::vector<int>& imwrite_parameters);
};

// The library links the codecs. The program replaces this function, and loads
// them when it first needs them (apps/mgsfm/codec_loading.cc).
extern "C" const ImageCodecs* MgsfmImageCodecs();

}  // namespace mgsfm
