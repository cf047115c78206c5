// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "priors/position_files.h"
#include "recordings/recording.h"
#include "recordings/recording_cameras.h"
#include "recordings/recording_import.h"

namespace mgsfm {

struct MeasuredGravity {
  std::vector<TimedVector> in_imu;
  // About each of two axes; nullopt if there is nothing to compare.
  std::optional<double> sigma_deg;
  bool is_by_orientation = false;
};

// The directions of gravity by a topic of sensor_msgs/Imu.
class RecordedGravity {
 public:
  // Chooses the topic. Throws Error as FindTopic.
  RecordedGravity(const Recording& recording,
                  const RecordingImportOptions& options,
                  const Context& context);

  int topic_idx() const { return topic_idx_; }  // -1: none
  // Takes a message of the topic. Throws BytesError if it is malformed.
  void Take(const RecordedMessage& message);

  // Lines "SECONDS GX GY GZ" at the given times, in the axes that the options
  // name; empty, with a warning, if they are unknown. Logs the standard
  // deviation about each of two axes.
  //
  // Gravity is along -z of the world of the orientation, if all messages have
  // one, or else opposite to the mean acceleration in the window around a time.
  // The gyroscope, if there is one, turns accelerations to the axes at that
  // time. The standard deviation of means is that of the changes between
  // adjacent windows; that of orientations contains that of the means.
  std::string Lines(const RecordedCamera& first, const FrameTree& frames,
                    const std::vector<int64_t>& times_ns) const;

 private:
  std::optional<Eigen::Quaterniond> AxesFromImu(const RecordedCamera& first,
                                                const FrameTree& frames) const;
  MeasuredGravity Measure() const;

  const Recording& recording_;
  const RecordingImportOptions& options_;
  const Context& context_;
  const int topic_idx_;
  std::map<int64_t, ImuMessage> messages_;  // by time
  size_t num_without_stamp_ = 0;
};

}  // namespace mgsfm
