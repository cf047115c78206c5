// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <string_view>

#include "recordings/recording.h"

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
// or ".png". Throws Error for another format, as above.
std::string ExtensionOf(const CompressedImageMessage& message);

// A gray image of 8 bits, no side of which exceeds `max_size_px`, of a message
// of such a topic. Throws as above, and Error if a file cannot be decoded.
cv::Mat SmallGrayOf(const RecordingTopic& topic, std::string_view message,
                    int max_size_px);

}  // namespace mgsfm
