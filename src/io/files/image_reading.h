// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <streambuf>
#include <string>

namespace mgsfm {

// The formats that are read: JPEG, PNG, TIFF, BMP, WebP and the portable
// formats P1 to P6 (PBM, PGM, PPM). OpenCV knows more, but some of their files
// can name other files, or state their size only after they are decoded.

// Width and height of the image that the decoder would allocate.
struct ImageSize {
  int64_t width = 0;
  int64_t height = 0;
};

// The size that the header of an image file states; nullopt for other formats
// and damaged headers. Reads no pixel.
std::optional<ImageSize> ReadImageSize(const std::string& file);

// The memory that decoding takes is proportional to the number of pixels, not
// to the size of the file, so it is limited. The largest cameras have 450
// million pixels; 200 million take up to 1.6 GB.
constexpr int kDefaultMaxNumPixels = 200'000'000;

struct DecodedImage {
  cv::Mat pixels;
  std::string warning;  // what the decoder says, in one line; empty if nothing
  // Pixels of 8 bits are the upper halves of 16 bits, of which the file uses
  // the lower 12 only, as the cameras of some machines do.
  bool is_nearly_black = false;
};

// `imread_flags` are those of cv::imread. Throws Error; its message is to
// follow the file name: "is truncated; ...".
DecodedImage DecodeImage(const std::string& file, int imread_flags,
                         int64_t max_num_pixels);

// The same for what people see: 12 bits in files of 16 fill the 8 bits.
cv::Mat DecodeForDisplay(const std::string& file, int imread_flags);

// Whether the name of an image, relative to the folder of images, stays in it.
// Models come from others: their names must not select files elsewhere.
bool StaysInFolder(const std::string& name);

// Throws std::bad_alloc if the exception reports a lack of memory, for which
// OpenCV has a code.
void RethrowLackOfMemory(const cv::Exception& exception);

// During its lifetime, the libraries that decode images use one thread, and
// what they print goes into DecodedImage::warning. Messages that others print
// to stderr or std::cerr are passed on. One object at a time.
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
