// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <string_view>

#include "files/image_reading.h"
#include "recordings/recording.h"
#include "recordings/recording_import.h"

namespace mgsfm {

// Whether messages of a topic are images.
bool IsImageTopic(const RecordingTopic& topic);

// The pixels of a message of sensor_msgs/Image as an image file has them: gray
// or BGR, of 8 or 16 bits. Bayer patterns are interpolated, YUV 4:2:2 is
// converted, transparency is dropped; all other encodings keep their values.
// Throws Error for an unknown encoding: "has the encoding ...", and BytesError
// for a size that does not fit the data.
cv::Mat PixelsOf(const ImageMessage& message);

// The extension of the file in a message of sensor_msgs/CompressedImage: ".jpg"
// or ".png". Throws Error for another format, as above, and BytesError for
// other bytes than the format says.
std::string ExtensionOf(const CompressedImageMessage& message);

// The size of the image in a message of such a topic. Throws as above.
ImageSize SizeOfImage(const RecordingTopic& topic, std::string_view message);

// A gray image of 8 bits, no side of which exceeds `max_size_px`. Throws as
// above.
cv::Mat SmallGrayOf(const RecordingTopic& topic, std::string_view message,
                    int max_size_px);

// A message that becomes a file.
struct ImageMessageTask {
  int topic_idx = 0;
  std::filesystem::path path;  // without extension
  std::string message;
  // Results: whether the file existed, and what is wrong with the message.
  bool was_present = false;
  std::string problem;
};

// Writes the file of an image unless it exists. Throws Error as above.
// Thread-safe.
void WriteImageMessage(const RecordingTopic& topic,
                       const RecordingImportOptions& options,
                       ImageMessageTask* task);

}  // namespace mgsfm
