// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/recording.h"

#include "fuzz/fuzz_target.h"
#include "recordings/byte_reader.h"
#include "recordings/image_messages.h"

namespace mgsfm {
namespace {

void ReadAs(const RecordingTopic& topic, std::string_view message) {
  const std::string& encoding = topic.encoding;
  if (topic.type == "sensor_msgs/Image") {
    const cv::Mat pixels = PixelsOf(ReadImageMessage(message, encoding));
    FUZZ_CHECK(!pixels.empty());
    FUZZ_CHECK(pixels.channels() == 1 || pixels.channels() == 3);
  } else if (topic.type == "sensor_msgs/CompressedImage") {
    (void)ExtensionOf(ReadCompressedImageMessage(message, encoding));
  } else if (topic.type == "sensor_msgs/CameraInfo") {
    (void)ReadCameraInfoMessage(message, encoding);
  } else if (topic.type == "sensor_msgs/NavSatFix") {
    const PoseMessage pose = ReadNavSatFixMessage(message, encoding);
    FUZZ_CHECK(!pose.is_valid || pose.world_from_child.translation.allFinite());
  } else if (topic.type == "nav_msgs/Odometry") {
    (void)ReadOdometryMessage(message, encoding);
  } else if (topic.type == "sensor_msgs/Imu") {
    const ImuMessage imu = ReadImuMessage(message, encoding);
    FUZZ_CHECK(!imu.acceleration || imu.acceleration->allFinite());
  } else {
    for (const auto& transform : ReadTransformMessages(message, encoding)) {
      FUZZ_CHECK(transform.parent_from_child.translation.allFinite());
    }
  }
}

}  // namespace

// The type of a topic selects how its messages are read.
void FuzzRecording(const std::string& input) {
  const std::filesystem::path path = FuzzFolder() / "recording";
  WriteTextFile(path, input);
  (void)Accepts([&] {
    const Recording recording({path}, Context());
    recording.Read(Mask(recording.topics().size(), true), Context(),
                   [&](const RecordedMessage& message) {
                     const RecordingTopic& topic =
                         recording.topics()[message.topic_idx];
                     if (!topic.IsReadable()) return;
                     try {
                       ReadAs(topic, message.data);
                     } catch (const BytesError&) {
                     } catch (const Error&) {
                     }
                   });
  });
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(recording, mgsfm::FuzzRecording)
