// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <streambuf>
#include <string>

namespace mgsfm {

// The formats that are read: JPEG, PNG, TIFF, BMP, WebP and the portable
// formats P1 to P6 (PBM, PGM, PPM). OpenCV supports more formats, but some can
// refer to other files, or reveal their size only after decoding.

// Width and height of the image that the decoder would allocate.
struct ImageSize {
  int64_t width = 0;
  int64_t height = 0;
};

// The longest side that OpenCV reads (OPENCV_IO_MAX_IMAGE_WIDTH).
constexpr int kMaxImageSide_px = 1 << 20;

// ReadImageSize needs no more bytes of a file. Only tags precede the size; the
// largest one, a preview, has at most 64 KiB.
constexpr size_t kMaxImageHeaderBytes = size_t{1} << 20;

// The size in the header of an image file; nullopt for other formats and
// damaged headers. Decodes no pixels.
std::optional<ImageSize> ReadImageSize(const std::string& file);

// The same for a file on disk, of which only the header is read; nullopt also
// if there is no such file.
std::optional<ImageSize> ReadImageSizeOf(const std::filesystem::path& path);

// The memory for decoding is proportional to the number of pixels, not to the
// size of the file, so the number of pixels is limited. The largest cameras
// have 450 million pixels; 200 million take up to 1.6 GB.
constexpr int kDefaultMaxNumPixels = 200'000'000;

struct DecodedImage {
  cv::Mat pixels;
  std::string warning;  // what the decoder says, in one line; empty if nothing
  // Pixels of 8 bits are the upper halves of 16 bits. Some machine vision
  // cameras use only the lower 12 bits.
  bool is_nearly_black = false;
};

// `imread_flags` are those of cv::imread. Throws Error; its message continues
// the file name: "is truncated; ...".
DecodedImage DecodeImage(const std::string& file, int imread_flags,
                         int64_t max_num_pixels);

// The same for display: 12 bits in 16-bit files are scaled to 8 bits.
cv::Mat DecodeForDisplay(const std::string& file, int imread_flags);

// Whether the name of an image, relative to the image folder, stays inside this
// folder. Names in models of others must not select files elsewhere.
bool StaysInFolder(const std::string& name);

// Throws std::bad_alloc if the exception reports a lack of memory, for which
// OpenCV has a code.
void RethrowLackOfMemory(const cv::Exception& exception);

// During the lifetime of this object, the libraries that decode images use one
// thread, and their output goes to DecodedImage::warning. Other output to
// stderr or std::cerr is passed on. One object at a time.
class QuietImageLibraries {
 public:
  QuietImageLibraries();
  ~QuietImageLibraries();
  QuietImageLibraries(const QuietImageLibraries&) = delete;
  QuietImageLibraries& operator=(const QuietImageLibraries&) = delete;

 private:
  int num_threads_;
  int log_level_;
  std::FILE* terminal_;
  std::unique_ptr<std::streambuf> error_stream_;
  std::streambuf* terminal_stream_;
};

}  // namespace mgsfm
