// SPDX-License-Identifier: BSD-3-Clause
#include "files/image_reading.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <iostream>
#include <limits>
#include <new>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string_view>

#include "base/file_reading.h"
#include "base/memory.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr const char* kCopyAgain = "; copy it again from its source";

// The bytes of a file. Bytes beyond its end are 0.
class Bytes {
 public:
  explicit Bytes(std::string_view file) : file_(file) {}

  size_t size() const { return file_.size(); }
  uint8_t operator[](size_t i) const {
    return i < file_.size() ? static_cast<uint8_t>(file_[i]) : 0;
  }
  bool Has(size_t begin, std::string_view text) const {
    return begin <= file_.size() &&
           file_.compare(begin, text.size(), text) == 0;
  }
  uint64_t Number(size_t begin, size_t num_bytes, bool is_little) const {
    uint64_t value = 0;
    for (size_t i = 0; i < num_bytes; ++i) {
      value = value << 8 | (*this)[begin + (is_little ? num_bytes - 1 - i : i)];
    }
    return value;
  }
  uint64_t BigEndian(size_t begin, size_t num_bytes) const {
    return Number(begin, num_bytes, false);
  }
  uint64_t LittleEndian(size_t begin, size_t num_bytes) const {
    return Number(begin, num_bytes, true);
  }

 private:
  std::string_view file_;
};

ImageSize SizeOf(uint64_t width, uint64_t height) {
  return {static_cast<int64_t>(width), static_cast<int64_t>(height)};
}

bool IsJpeg(const Bytes& file) { return file.Has(0, "\xff\xd8\xff"); }

struct JpegHeader {
  std::optional<ImageSize> size;
  bool is_complete = false;  // contains the end marker
};

// A file is a sequence of markers 0xff m, most of them followed by a segment
// with its length (ITU-T T.81, annex B). Marker 0xda is followed by coded data,
// in which 0xff precedes 0 or a restart marker. 0xc0 to 0xcf begin a frame,
// except three that define tables.
JpegHeader ReadJpeg(const Bytes& file) {
  JpegHeader header;
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
    if (marker == 0xd9) header.is_complete = true;
    if (marker == 0xd9 || i + 3 >= file.size()) break;
    const bool is_frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 &&
                          marker != 0xc8 && marker != 0xcc;
    if (is_frame && !header.size) {
      header.size = SizeOf(file.BigEndian(i + 7, 2), file.BigEndian(i + 5, 2));
    }
    i += 2 + file.BigEndian(i + 2, 2);
  }
  return header;
}

bool IsPng(const Bytes& file) { return file.Has(0, "\x89PNG\r\n\x1a\n"); }

// Whether the file contains the last chunk; decoders silently fill in missing
// data. A file is the signature followed by chunks: length (big-endian), type,
// data and 4 bytes of checksum.
bool IsCompletePng(const Bytes& file) {
  for (size_t i = 8; i + 12 <= file.size(); i += 12 + file.BigEndian(i, 4)) {
    if (file.Has(i + 4, "IEND")) return true;
  }
  return false;
}

// Calls use(tag, type, position) for the entries of the first directory of a
// TIFF file (TIFF 6.0, section 2): tag, type, count and value, which is at the
// position.
template <class Use>
void ForEachTiffEntry(const Bytes& file, bool is_little, const Use& use) {
  const size_t directory = file.Number(4, 4, is_little);
  const size_t num_entries = file.Number(directory, 2, is_little);
  for (size_t k = 0; k < num_entries; ++k) {
    const size_t entry = directory + 2 + 12 * k;
    use(file.Number(entry, 2, is_little), file.Number(entry + 2, 2, is_little),
        entry + 8);
  }
}

bool IsLittleTiff(const Bytes& file) {
  return file.Has(0, std::string_view("II*\0", 4));
}

bool IsTiff(const Bytes& file) {
  return IsLittleTiff(file) || file.Has(0, std::string_view("MM\0*", 4));
}

// The decoder allocates a tile, too, which may be larger than the image.
std::optional<ImageSize> ReadTiffSize(const Bytes& file) {
  constexpr uint64_t kWidth = 256, kHeight = 257;
  constexpr uint64_t kTileWidth = 322, kTileHeight = 323;
  constexpr uint64_t kShort = 3, kLong = 4;
  const bool is_little = IsLittleTiff(file);
  std::optional<ImageSize> size = ImageSize();
  ForEachTiffEntry(
      file, is_little, [&](uint64_t tag, uint64_t type, size_t position) {
        const bool is_width = tag == kWidth || tag == kTileWidth;
        const bool is_height = tag == kHeight || tag == kTileHeight;
        if (!size || !(is_width || is_height)) return;
        if (type != kShort && type != kLong) return size.reset();
        int64_t& side = is_width ? size->width : size->height;
        side =
            std::max(side, static_cast<int64_t>(file.Number(
                               position, type == kShort ? 2 : 4, is_little)));
      });
  return size;
}

// "P5 640 480 255 ...", with comments from '#' to the end of the line.
std::optional<ImageSize> ReadPortableSize(const Bytes& file) {
  uint64_t numbers[2] = {};
  size_t i = 2;
  for (uint64_t& number : numbers) {
    while (i < file.size() && (std::isspace(file[i]) != 0 || file[i] == '#')) {
      if (file[i++] != '#') continue;
      while (i < file.size() && file[i] != '\n') ++i;
    }
    for (; std::isdigit(file[i]) != 0; ++i) {
      number = std::min<uint64_t>(10 * number + (file[i] - '0'), 1u << 31);
    }
  }
  return SizeOf(numbers[0], numbers[1]);
}

// https://developers.google.com/speed/webp/docs/riff_container and RFC 6386,
// section 9.1.
std::optional<ImageSize> ReadWebpSize(const Bytes& file) {
  if (file.Has(12, "VP8X")) {
    return SizeOf(1 + file.LittleEndian(24, 3), 1 + file.LittleEndian(27, 3));
  }
  if (file.Has(12, "VP8L")) {
    const uint64_t bits = file.LittleEndian(21, 4);
    return SizeOf(1 + (bits & 0x3fff), 1 + (bits >> 14 & 0x3fff));
  }
  if (file.Has(12, "VP8 ")) {
    return SizeOf(file.LittleEndian(26, 2) & 0x3fff,
                  file.LittleEndian(28, 2) & 0x3fff);
  }
  return std::nullopt;
}

// The height is negative if the rows are in descending order.
ImageSize ReadBmpSize(const Bytes& file) {
  constexpr uint64_t kCoreHeaderSize = 12;
  if (file.LittleEndian(14, 4) == kCoreHeaderSize) {
    return SizeOf(file.LittleEndian(18, 2), file.LittleEndian(20, 2));
  }
  const auto side = [&](size_t begin) {
    const auto value = static_cast<int32_t>(file.LittleEndian(begin, 4));
    return static_cast<uint64_t>(std::abs(int64_t{value}));
  };
  return SizeOf(side(18), side(22));
}

std::optional<ImageSize> ReadSize(const Bytes& file) {
  if (IsJpeg(file)) return ReadJpeg(file).size;
  if (IsPng(file)) return SizeOf(file.BigEndian(16, 4), file.BigEndian(20, 4));
  if (IsTiff(file)) return ReadTiffSize(file);
  if (file.Has(0, "BM")) return ReadBmpSize(file);
  if (file[0] == 'P' && file[1] >= '1' && file[1] <= '6') {
    return ReadPortableSize(file);
  }
  if (file.Has(0, "RIFF") && file.Has(8, "WEBP")) return ReadWebpSize(file);
  return std::nullopt;
}

// ------------------------------------------------------ messages of decoders

// Receives the stderr messages of this thread while it decodes.
thread_local std::string* decoder_messages = nullptr;

// Returns false if this thread is not decoding an image.
bool KeepMessage(const char* text, size_t size) {
  constexpr size_t kMaxSize = 200;  // reserved below
  if (decoder_messages == nullptr) return false;
  decoder_messages->append(text,
                           std::min(size, kMaxSize - decoder_messages->size()));
  return true;
}

// Called by the C library for output to stderr.
ssize_t WriteMessage(void* terminal, const char* text, size_t size) {
  if (KeepMessage(text, size)) return static_cast<ssize_t>(size);
  return static_cast<ssize_t>(
      std::fwrite(text, 1, size, static_cast<std::FILE*>(terminal)));
}

// The same for std::cerr, because some decoders of OpenCV print their
// exceptions. Unbuffered, so that threads do not disturb each other.
class ErrorStream : public std::streambuf {
 public:
  explicit ErrorStream(std::streambuf* terminal) : terminal_(terminal) {}

 protected:
  std::streamsize xsputn(const char* text, std::streamsize size) override {
    if (KeepMessage(text, static_cast<size_t>(size))) return size;
    return terminal_->sputn(text, size);
  }
  int overflow(int character) override {
    if (character == traits_type::eof()) return 0;
    const char text = traits_type::to_char_type(character);
    return xsputn(&text, 1) == 1 ? character : traits_type::eof();
  }
  int sync() override {
    return decoder_messages == nullptr ? terminal_->pubsync() : 0;
  }

 private:
  std::streambuf* terminal_;
};

class MessageCapture {
 public:
  MessageCapture() {
    messages_.reserve(256);
    decoder_messages = &messages_;
  }
  ~MessageCapture() { decoder_messages = nullptr; }
  MessageCapture(const MessageCapture&) = delete;
  MessageCapture& operator=(const MessageCapture&) = delete;

  std::string Line() const {
    std::string line = Printable(messages_);
    line.erase(line.find_last_not_of(' ') + 1);
    return line;
  }

 private:
  std::string messages_;
};

// PNG and TIFF are the 16-bit formats that cameras write.
bool MayHaveSixteenBits(const Bytes& file) {
  return IsPng(file) ? file[24] == 16 : file.Has(0, "II") || file.Has(0, "MM");
}

// The position of the tag Orientation in the first directory of a TIFF file: of
// the lower byte of its value.
std::optional<size_t> FindTiffOrientation(const Bytes& file) {
  constexpr uint64_t kOrientation = 274;
  std::optional<size_t> found;
  if (!IsTiff(file)) return found;
  const bool is_little = IsLittleTiff(file);
  ForEachTiffEntry(
      file, is_little, [&](uint64_t tag, uint64_t /*type*/, size_t position) {
        if (!is_little) ++position;
        if (tag == kOrientation && !found && position < file.size()) {
          found = position;
        }
      });
  return found;
}

cv::Mat Decode(const std::string& file, int imread_flags) {
  // The TIFF decoder rotates images, whatever the flags are.
  const auto orientation = FindTiffOrientation(Bytes(file));
  const bool ignores = (imread_flags & cv::IMREAD_IGNORE_ORIENTATION) != 0;
  constexpr char kAsStored = 1;
  if (orientation && ignores && file[*orientation] != kAsStored) {
    std::string as_stored = file;
    as_stored[*orientation] = kAsStored;
    return Decode(as_stored, imread_flags);
  }
  const cv::Mat view(1, static_cast<int>(file.size()), CV_8U,
                     const_cast<char*>(file.data()));
  return cv::imdecode(view, imread_flags);
}

constexpr double kMaxOfTwelveBits = 4095.0;

bool UsesTwelveBits(const cv::Mat& pixels) {
  double max = 0.0;
  if (pixels.depth() != CV_16U) return false;
  cv::minMaxLoc(pixels.reshape(1), nullptr, &max);
  return max > 0.0 && max <= kMaxOfTwelveBits;
}

// Sets up the codecs of OpenCV in the calling thread. GDAL, one of them, ends
// the process if memory runs out there, so memory is tested first.
void SetUpCodecs() {
  RequireMemory(size_t{32} << 20);  // the setup takes 10 MB
  std::string image = "P5 1 1 255\n0";
  const cv::Mat view(1, static_cast<int>(image.size()), CV_8U, image.data());
  (void)cv::imdecode(view, cv::IMREAD_GRAYSCALE);
}

}  // namespace

std::optional<ImageSize> ReadImageSize(const std::string& file) {
  const std::optional<ImageSize> size = ReadSize(Bytes(file));
  return size && size->width > 0 && size->height > 0 ? size : std::nullopt;
}

std::optional<ImageSize> ReadImageSizeOf(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return std::nullopt;
  return ReadImageSize(ReadFile(path, "", kMaxImageHeaderBytes));
}

DecodedImage DecodeImage(const std::string& file, int imread_flags,
                         int64_t max_num_pixels) {
  const Bytes bytes(file);
  if (file.empty()) throw Error(std::string("is empty") + kCopyAgain);
  if (file.size() > std::numeric_limits<int>::max()) {
    throw Error("has more than 2 GB; compress it");
  }
  if ((IsJpeg(bytes) && !ReadJpeg(bytes).is_complete) ||
      (IsPng(bytes) && !IsCompletePng(bytes))) {
    throw Error(std::string("is truncated") + kCopyAgain);
  }
  const std::optional<ImageSize> size = ReadImageSize(file);
  DecodedImage image;
  if (size && size->width > max_num_pixels / size->height) {
    throw Error("has " + SizeText(size->width, size->height) +
                " pixels, more than " + std::to_string(max_num_pixels) +
                "; make it smaller, or raise ImageReader.max_num_pixels");
  }
  const MessageCapture capture;
  try {
    if (size) {
      image.pixels = Decode(file, imread_flags);
      image.is_nearly_black =
          image.pixels.depth() == CV_8U && MayHaveSixteenBits(bytes) &&
          UsesTwelveBits(Decode(file, imread_flags | cv::IMREAD_ANYDEPTH));
    }
  } catch (const cv::Exception& exception) {
    RethrowLackOfMemory(exception);
    image.pixels.release();
  }
  image.warning = capture.Line();
  if (image.pixels.empty()) {
    throw Error("is damaged or not an image of a supported format" +
                (image.warning.empty() ? "" : " (" + image.warning + ")") +
                "; remove it or convert it to JPEG or PNG");
  }
  return image;
}

cv::Mat DecodeForDisplay(const std::string& file, int imread_flags) {
  DecodedImage image = DecodeImage(file, imread_flags, kDefaultMaxNumPixels);
  if (!image.is_nearly_black) return image.pixels;
  cv::Mat bright;
  DecodeImage(file, imread_flags | cv::IMREAD_ANYDEPTH, kDefaultMaxNumPixels)
      .pixels.convertTo(bright, CV_8U, 255.0 / kMaxOfTwelveBits);
  return bright;
}

bool StaysInFolder(const std::string& name) {
  const std::filesystem::path path(name);
  return !name.empty() && path.is_relative() && !Contains(path, "..");
}

void RethrowLackOfMemory(const cv::Exception& exception) {
  if (exception.code == cv::Error::StsNoMem) throw std::bad_alloc();
}

QuietImageLibraries::QuietImageLibraries()
    : num_threads_(cv::getNumThreads()),
      log_level_(cv::utils::logging::getLogLevel()),
      terminal_(stderr),
      error_stream_(std::make_unique<ErrorStream>(std::cerr.rdbuf())),
      terminal_stream_(std::cerr.rdbuf()) {
  SetUpCodecs();
  cv::setNumThreads(1);
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  // Nothing below may throw: std::cerr would keep a buffer that no longer
  // exists.
  std::cerr.rdbuf(error_stream_.get());
  // libjpeg and libpng print to stderr, unless OpenCV asked them not to.
  cookie_io_functions_t functions{};
  functions.write = WriteMessage;
  std::FILE* stream = fopencookie(terminal_, "w", functions);
  if (stream == nullptr) return;
  std::setvbuf(stream, nullptr, _IONBF, 0);
  stderr = stream;
}

QuietImageLibraries::~QuietImageLibraries() {
  if (stderr != terminal_) {
    std::fclose(stderr);
    stderr = terminal_;
  }
  std::cerr.rdbuf(terminal_stream_);
  cv::setNumThreads(num_threads_);
  cv::utils::logging::setLogLevel(
      static_cast<cv::utils::logging::LogLevel>(log_level_));
}

}  // namespace mgsfm
