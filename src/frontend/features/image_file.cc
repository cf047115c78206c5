// SPDX-License-Identifier: BSD-3-Clause
#include "features/image_file.h"

#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "base/file_reading.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Scales images of more than 8 bits such that the brightest pixel is 255.
cv::Mat To8Bits(const cv::Mat& image) {
  if (image.depth() == CV_8U) return image;
  double max = 0.0;
  cv::minMaxLoc(image, nullptr, &max);
  cv::Mat scaled;
  image.convertTo(scaled, CV_8U, max > 0.0 ? 255.0 / max : 0.0);
  return scaled;
}

GrayImage ToGrayImage(const cv::Mat& image) {
  MGSFM_CHECK_EQ(image.channels(), 1);
  const cv::Mat scaled = To8Bits(image);
  GrayImage gray(scaled.rows, scaled.cols);
  for (int y = 0; y < scaled.rows; ++y) {
    std::memcpy(gray.row(y).data(), scaled.ptr(y),
                static_cast<size_t>(scaled.cols));
  }
  return gray;
}

DecodedImage DecodeGray(const std::string& file, int64_t max_num_pixels) {
  return DecodeImage(file,
                     cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH |
                         cv::IMREAD_IGNORE_ORIENTATION,
                     max_num_pixels);
}

}  // namespace

std::string ReadImageFile(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) throw Error("does not exist");
  if (!std::filesystem::is_regular_file(path, ignored)) {
    throw Error("is not a regular file");
  }
  return ReadFile(path, "is a file that");
}

ImageFile DecodeImageFile(const std::string& file, int64_t max_num_pixels) {
  DecodedImage image = DecodeGray(file, max_num_pixels);
  return {ToGrayImage(image.pixels),
          ReadTags(file, image.pixels.cols, image.pixels.rows),
          std::move(image.warning)};
}

std::optional<GrayImage> ReadMask(const std::filesystem::path& path,
                                  int64_t max_num_pixels) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return std::nullopt;
  // Any number but 0 shows a pixel, in 16 bits too.
  const DecodedImage mask = DecodeGray(ReadImageFile(path), max_num_pixels);
  return ToGrayImage(mask.pixels != 0);
}

}  // namespace mgsfm
