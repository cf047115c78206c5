// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/image_messages.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "base/text.h"
#include "base/text_tools.h"
#include "files/file_operations.h"
#include "files/image_writing.h"
#include "mgsfm/base/error.h"
#include "recordings/byte_reader.h"

namespace mgsfm {
namespace {

// An encoding of sensor_msgs/image_encodings.h, and the conversion to gray or
// BGR. OpenCV names Bayer patterns by the second row and column.
struct ImageEncoding {
  const char* name;
  int type;
  std::optional<int> conversion;
};

constexpr ImageEncoding kImageEncodings[] = {
    {"mono8", CV_8UC1, std::nullopt},
    {"8UC1", CV_8UC1, std::nullopt},
    {"mono16", CV_16UC1, std::nullopt},
    {"16UC1", CV_16UC1, std::nullopt},
    {"bgr8", CV_8UC3, std::nullopt},
    {"8UC3", CV_8UC3, std::nullopt},
    {"rgb8", CV_8UC3, cv::COLOR_RGB2BGR},
    {"bgra8", CV_8UC4, cv::COLOR_BGRA2BGR},
    {"8UC4", CV_8UC4, cv::COLOR_BGRA2BGR},
    {"rgba8", CV_8UC4, cv::COLOR_RGBA2BGR},
    {"bgr16", CV_16UC3, std::nullopt},
    {"rgb16", CV_16UC3, cv::COLOR_RGB2BGR},
    {"bgra16", CV_16UC4, cv::COLOR_BGRA2BGR},
    {"rgba16", CV_16UC4, cv::COLOR_RGBA2BGR},
    {"bayer_rggb8", CV_8UC1, cv::COLOR_BayerBG2BGR},
    {"bayer_bggr8", CV_8UC1, cv::COLOR_BayerRG2BGR},
    {"bayer_gbrg8", CV_8UC1, cv::COLOR_BayerGR2BGR},
    {"bayer_grbg8", CV_8UC1, cv::COLOR_BayerGB2BGR},
    {"bayer_rggb16", CV_16UC1, cv::COLOR_BayerBG2BGR},
    {"bayer_bggr16", CV_16UC1, cv::COLOR_BayerRG2BGR},
    {"bayer_gbrg16", CV_16UC1, cv::COLOR_BayerGR2BGR},
    {"bayer_grbg16", CV_16UC1, cv::COLOR_BayerGB2BGR},
    {"yuv422", CV_8UC2, cv::COLOR_YUV2BGR_UYVY},
    {"uyvy", CV_8UC2, cv::COLOR_YUV2BGR_UYVY},
    {"yuv422_yuy2", CV_8UC2, cv::COLOR_YUV2BGR_YUY2},
    {"yuyv", CV_8UC2, cv::COLOR_YUV2BGR_YUY2},
};

const ImageEncoding& FindEncoding(const std::string& name) {
  for (const ImageEncoding& encoding : kImageEncodings) {
    if (name == encoding.name) return encoding;
  }
  throw Error("has the encoding '" + Printable(name) +
              "', which is not that of a picture; leave the topic out of "
              "image_topics, or convert it to bgr8 or mono8");
}

void SwapBytes(cv::Mat* image) {
  for (int y = 0; y < image->rows; ++y) {
    uchar* const row = image->ptr(y);
    for (size_t i = 0; i + 1 < image->cols * image->elemSize(); i += 2) {
      std::swap(row[i], row[i + 1]);
    }
  }
}

// The pixels as they are in the message.
cv::Mat RawPixels(const ImageMessage& message, int type) {
  const uint64_t row_bytes = uint64_t{message.width_px} * CV_ELEM_SIZE(type);
  const uint64_t num_rows = message.height_px;
  const bool is_size = message.width_px >= 1 && num_rows >= 1 &&
                       message.width_px <= kMaxImageSide_px &&
                       num_rows <= kMaxImageSide_px &&
                       num_rows * message.width_px <= kDefaultMaxNumPixels;
  if (!is_size || message.row_bytes < row_bytes ||
      message.data.size() < (num_rows - 1) * message.row_bytes + row_bytes) {
    throw BytesError("has " + std::to_string(message.data.size()) +
                     " bytes, which do not fit " +
                     SizeText(message.width_px, message.height_px) +
                     " pixels of " + message.encoding);
  }
  cv::Mat image(static_cast<int>(num_rows), static_cast<int>(message.width_px),
                type);
  for (int y = 0; y < image.rows; ++y) {
    std::memcpy(image.ptr(y), message.data.data() + y * message.row_bytes,
                row_bytes);
  }
  return image;
}

}  // namespace

bool IsImageTopic(const RecordingTopic& topic) {
  return topic.type == "sensor_msgs/Image" ||
         topic.type == "sensor_msgs/CompressedImage";
}

cv::Mat PixelsOf(const ImageMessage& message) {
  const ImageEncoding& encoding = FindEncoding(message.encoding);
  cv::Mat image = RawPixels(message, encoding.type);
  if (image.depth() == CV_16U && message.is_big_endian) SwapBytes(&image);
  if (!encoding.conversion) return image;
  cv::Mat converted;
  try {
    cv::cvtColor(image, converted, *encoding.conversion);
  } catch (const cv::Exception& exception) {
    RethrowLackOfMemory(exception);
    throw BytesError("has a size, " +
                     SizeText(message.width_px, message.height_px) +
                     ", that does not fit " + message.encoding);
  }
  return converted;
}

std::string ExtensionOf(const CompressedImageMessage& message) {
  if (message.data.substr(0, 3) == "\xff\xd8\xff") return ".jpg";
  if (message.data.substr(0, 8) == "\x89PNG\r\n\x1a\n") return ".png";
  for (const char* known : {"jpeg", "jpg", "png"}) {
    if (ToLower(message.format).find(known) != std::string::npos) {
      throw BytesError("has no image of the format " + message.format);
    }
  }
  throw Error("has the format '" + Printable(message.format) +
              "', which is neither JPEG nor PNG; leave the topic out of "
              "image_topics, or convert it");
}

ImageSize SizeOfImage(const RecordingTopic& topic, std::string_view message) {
  if (topic.type == "sensor_msgs/Image") {
    const cv::Mat pixels = PixelsOf(ReadImageMessage(message, topic.encoding));
    return {pixels.cols, pixels.rows};
  }
  const auto file = ReadCompressedImageMessage(message, topic.encoding);
  (void)ExtensionOf(file);
  const auto size = ReadImageSize(std::string(file.data));
  if (!size) throw BytesError("has an image without size");
  return *size;
}

cv::Mat SmallGrayOf(const RecordingTopic& topic, std::string_view message,
                    int max_size_px) {
  cv::Mat image;
  if (topic.type == "sensor_msgs/Image") {
    image = PixelsOf(ReadImageMessage(message, topic.encoding));
    if (image.channels() == 3) cv::cvtColor(image, image, cv::COLOR_BGR2GRAY);
    // Of 16 bits, cameras may use 10 or 12 only.
    if (image.depth() != CV_8U) {
      cv::normalize(image, image, 0, 255, cv::NORM_MINMAX, CV_8U);
    }
  } else {
    const auto file = ReadCompressedImageMessage(message, topic.encoding);
    (void)ExtensionOf(file);
    try {
      image = DecodeImage(std::string(file.data), cv::IMREAD_GRAYSCALE,
                          kDefaultMaxNumPixels)
                  .pixels;
    } catch (const Error& error) {
      throw BytesError(error.what());
    }
  }
  const double scale = std::min(
      1.0, static_cast<double>(max_size_px) / std::max(image.cols, image.rows));
  const auto scaled = [&](int size_px) {
    return std::max(1, static_cast<int>(std::lround(size_px * scale)));
  };
  if (scale == 1.0) return image;
  cv::Mat small;
  cv::resize(image, small, {scaled(image.cols), scaled(image.rows)}, 0.0, 0.0,
             cv::INTER_AREA);
  return small;
}

void WriteImageMessage(const RecordingTopic& topic,
                       const RecordingImportOptions& options,
                       ImageMessageTask* task) {
  const auto path_with =
      [&](const std::string& extension) -> std::filesystem::path {
    return task->path.string() + extension;
  };
  task->was_present =
      IsWritten(path_with(".png")) || IsWritten(path_with(".jpg"));
  if (task->was_present) return;
  try {
    if (topic.type != "sensor_msgs/Image") {
      const auto file =
          ReadCompressedImageMessage(task->message, topic.encoding);
      ReplaceOneOfMany(path_with(ExtensionOf(file)), std::string(file.data));
      return;
    }
    const std::string extension =
        "." + std::string(EnumName(*options.image_format));
    ReplaceOneOfMany(
        path_with(extension),
        EncodeImage(extension,
                    PixelsOf(ReadImageMessage(task->message, topic.encoding)),
                    {cv::IMWRITE_JPEG_QUALITY, options.jpeg_quality}));
  } catch (const BytesError& error) {
    task->problem = error.what();
  }
}

}  // namespace mgsfm
