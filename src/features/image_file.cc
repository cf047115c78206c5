// SPDX-License-Identifier: BSD-3-Clause
#include "features/image_file.h"

#include <cstring>
#include <exiv2/exiv2.hpp>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr const char* kCopyAgain = "; copy it again from its source";

std::vector<uint8_t> ReadBytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Error("cannot be read; check its permissions");
  std::vector<uint8_t> bytes{std::istreambuf_iterator<char>(file),
                             std::istreambuf_iterator<char>()};
  if (file.bad()) throw Error("cannot be read; check its disk");
  if (bytes.empty()) throw Error(std::string("is empty") + kCopyAgain);
  return bytes;
}

bool IsJpeg(const std::vector<uint8_t>& file) {
  return file.size() > 3 && file[0] == 0xff && file[1] == 0xd8 &&
         file[2] == 0xff;
}

// Whether the file contains the end marker; decoders silently fill in missing
// data. A file is a sequence of markers 0xff m, most of them followed by a
// segment with its length (ITU-T T.81, annex B). The segment of marker 0xda is
// followed by coded data, in which 0xff precedes 0 or a restart marker.
bool IsCompleteJpeg(const std::vector<uint8_t>& file) {
  size_t i = 2;
  while (i + 1 < file.size()) {
    const uint8_t marker = file[i + 1];
    const bool is_in_data = file[i] != 0xff || marker == 0;
    const bool is_bare =
        marker == 0xff || marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8);
    if (is_in_data || is_bare) {
      i += is_in_data || marker == 0xff ? 1 : 2;
      continue;
    }
    if (marker == 0xd9) return true;
    if (i + 3 >= file.size()) return false;
    i += 2 + (static_cast<size_t>(file[i + 2]) << 8 | file[i + 3]);
  }
  return false;
}

bool IsPng(const std::vector<uint8_t>& file) {
  constexpr uint8_t kSignature[] = {0x89, 'P',  'N',  'G',
                                    0x0d, 0x0a, 0x1a, 0x0a};
  return file.size() >= sizeof(kSignature) &&
         std::memcmp(file.data(), kSignature, sizeof(kSignature)) == 0;
}

// Whether the file contains the last chunk. A file is the signature followed by
// chunks: length (big-endian), type, data and 4 bytes of checksum.
bool IsCompletePng(const std::vector<uint8_t>& file) {
  size_t i = 8;
  while (i + 12 <= file.size()) {
    size_t length = 0;
    for (size_t k = 0; k < 4; ++k) length = length << 8 | file[i + k];
    if (std::memcmp(file.data() + i + 4, "IEND", 4) == 0) return true;
    i += 12 + length;
  }
  return false;
}

// Scales images of more than 8 bits such that the brightest pixel is 255.
cv::Mat To8Bits(const cv::Mat& image) {
  if (image.depth() == CV_8U) return image;
  double max = 0.0;
  cv::minMaxLoc(image, nullptr, &max);
  cv::Mat scaled;
  image.convertTo(scaled, CV_8U, max > 0.0 ? 255.0 / max : 0.0);
  return scaled;
}

GrayImage Decode(const std::vector<uint8_t>& file) {
  if ((IsJpeg(file) && !IsCompleteJpeg(file)) ||
      (IsPng(file) && !IsCompletePng(file))) {
    throw Error(std::string("is truncated") + kCopyAgain);
  }
  cv::Mat image;
  try {
    image = cv::imdecode(file, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH |
                                   cv::IMREAD_IGNORE_ORIENTATION);
    if (!image.empty()) image = To8Bits(image);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty() || image.channels() != 1) {
    throw Error(
        "is damaged or not an image of a supported format; remove it or "
        "convert it to JPEG or PNG");
  }
  GrayImage gray(image.rows, image.cols);
  for (int y = 0; y < image.rows; ++y) {
    std::memcpy(gray.row(y).data(), image.ptr(y),
                static_cast<size_t>(image.cols));
  }
  return gray;
}

}  // namespace

ImageFile ReadImageFile(const std::filesystem::path& path) {
  if (!std::filesystem::exists(path)) throw Error("does not exist");
  if (!std::filesystem::is_regular_file(path))
    throw Error("is not a regular file");
  const std::vector<uint8_t> bytes = ReadBytes(path);
  ImageFile file;
  file.gray = Decode(bytes);
  file.tags = ReadTags(bytes, static_cast<int>(file.gray.cols()),
                       static_cast<int>(file.gray.rows()));
  return file;
}

std::optional<GrayImage> ReadMask(const std::filesystem::path& path) {
  if (!std::filesystem::is_regular_file(path)) return std::nullopt;
  return Decode(ReadBytes(path));
}

QuietImageLibraries::QuietImageLibraries()
    : num_threads_(cv::getNumThreads()),
      log_level_(cv::utils::logging::getLogLevel()) {
  cv::setNumThreads(1);
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
}

QuietImageLibraries::~QuietImageLibraries() {
  cv::setNumThreads(num_threads_);
  cv::utils::logging::setLogLevel(
      static_cast<cv::utils::logging::LogLevel>(log_level_));
}

}  // namespace mgsfm
