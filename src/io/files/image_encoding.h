// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace mgsfm {

// The bytes of an image file in the format of the extension (".jpg").
// `imwrite_parameters` are those of cv::imwrite. Throws Error; its message is
// to follow the file name: "cannot be written as ...".
std::string EncodeImage(const std::string& extension, const cv::Mat& image,
                        const std::vector<int>& imwrite_parameters = {});

}  // namespace mgsfm
