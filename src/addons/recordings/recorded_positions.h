// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "recordings/moving_frames.h"
#include "recordings/recording.h"
#include "recordings/recording_cameras.h"
#include "recordings/recording_import.h"

namespace mgsfm {

// A topic that an option names, or the only one of the first type that has
// messages.
struct TopicChoice {
  const char* option = "";   // "position_topic"
  std::string wanted;        // its value: a topic, auto or none
  const char* content = "";  // "positions"
  std::vector<std::string> automatic_types;
  std::vector<std::string> other_types;
};
// -1 for none, and, with a warning, for several. Throws Error if the named
// topic has none of the types.
int FindTopic(const Recording& recording, const TopicChoice& choice,
              const Context& context);

// Warns unless the number of headers without a time is 0.
void WarnOfMissingStamps(const std::string& subject, size_t num,
                         const char* content, const Context& context);

// The positions of a recording.
class RecordedPositions {
 public:
  // Chooses the topic. Throws Error as above.
  RecordedPositions(const Recording& recording,
                    const RecordingImportOptions& options,
                    const Context& context);

  int topic_idx() const { return topic_idx_; }  // -1: none
  bool IsEmpty() const { return poses_.empty(); }
  bool AreGps() const;

  // Takes a message of the topic. Throws BytesError if it is malformed.
  void Take(const RecordedMessage& message);
  // After the last message. Throws Error if /tf does not tell the positions.
  void Finish(const RecordedCamera& first, const FrameTree& frames);
  // Lines "time x y z qx qy qz qw": of the antenna in degrees and meters, or
  // poses of the first camera, where the frames connect it with the body.
  std::string Lines(const RecordedCamera& first, const FrameTree& frames) const;

 private:
  const RecordingTopic& Topic() const {
    return recording_.topics()[topic_idx_];
  }
  bool AreTransforms() const;
  int64_t TimeOf(int64_t stamp_ns, int64_t received_ns);

  const Recording& recording_;
  const RecordingImportOptions& options_;
  const Context& context_;
  const int topic_idx_;
  MovingFrames moving_;
  std::map<int64_t, PoseMessage> poses_;  // by time
  size_t num_without_stamp_ = 0;
};

// "001700.000000000".
std::string TimeText(int64_t time_ns);

}  // namespace mgsfm
