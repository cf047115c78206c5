// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/image_writer.h"

#include <opencv2/imgcodecs.hpp>

#include "files/file_operations.h"
#include "files/image_writing.h"
#include "mgsfm/base/error.h"
#include "recordings/byte_reader.h"
#include "recordings/image_messages.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

bool HasImage(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored) && fs::file_size(path, ignored) > 0;
}

}  // namespace

void WriteImageMessage(const RecordingTopic& topic,
                       const RecordingImportOptions& options,
                       ImageMessageTask* task) {
  const auto path_with = [&](const std::string& extension) -> fs::path {
    return task->path.string() + extension;
  };
  task->was_present =
      HasImage(path_with(".png")) || HasImage(path_with(".jpg"));
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
