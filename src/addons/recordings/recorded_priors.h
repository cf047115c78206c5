// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "geometry/frame_tree.h"
#include "mgsfm/base/context.h"
#include "recordings/imu_gravity.h"
#include "recordings/moving_frames.h"
#include "recordings/recording.h"
#include "recordings/recording_cameras.h"
#include "recordings/recording_import.h"

namespace mgsfm {

// The positions and directions of gravity of a recording.
class RecordedPriors {
 public:
  // Chooses the topics. Throws Error if an option names one that does not exist
  // or has no such messages.
  RecordedPriors(const Recording& recording,
                 const RecordingImportOptions& options, const Context& context);

  bool Have(int topic_idx) const {
    return topic_idx == position_topic_ || topic_idx == imu_topic_;
  }
  // Takes a message of one of the topics. Throws BytesError if it is malformed.
  void Take(const RecordedMessage& message);
  // After the last message. Throws Error if /tf does not tell the positions.
  void Finish(const RecordedCamera& first, const FrameTree& frames);

  bool PositionsAreGps() const;
  // Lines "SECONDS X Y Z QX QY QZ QW": of the antenna in degrees and meters, or
  // poses of the first camera, where the frames connect it with the body; empty
  // without positions.
  std::string PositionLines(const RecordedCamera& first,
                            const FrameTree& frames) const;
  // Lines "SECONDS GX GY GZ" at the given times, in the axes that the options
  // name; empty, with a message, if they are unknown. Logs the standard
  // deviation. For one call, as the messages are many.
  std::string GravityLines(const RecordedCamera& first, const FrameTree& frames,
                           const std::vector<int64_t>& times_ns);

 private:
  const RecordingTopic& PositionTopic() const {
    return recording_.topics()[position_topic_];
  }
  bool PositionsAreTransforms() const;
  void TakePosition(const RecordedMessage& message);
  // The time of the header, or else of the recorder.
  int64_t TimeOf(int64_t stamp_ns, const RecordedMessage& message);
  // A warning if the options name the topic.
  void NoGravity(const std::string& why) const;
  std::optional<Eigen::Quaterniond> AxesFromImu(const RecordedCamera& first,
                                                const FrameTree& frames) const;

  const Recording& recording_;
  const RecordingImportOptions& options_;
  const Context& context_;
  const int position_topic_;  // -1: none
  const int imu_topic_;
  MovingFrames moving_;
  std::map<int64_t, PoseMessage> positions_;  // by time
  std::vector<ImuMessage> imu_;
  std::string imu_frame_;                    // of the first message
  std::map<int, size_t> num_without_stamp_;  // by topic
};

// "001700.000000000".
std::string TimeText(int64_t time_ns);

}  // namespace mgsfm
