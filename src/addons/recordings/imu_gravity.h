// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "priors/position_files.h"
#include "recordings/ros_messages.h"

namespace mgsfm {

struct MeasuredGravity {
  std::vector<TimedVector> in_imu;
  // About each of two axes; nullopt if there is nothing to compare.
  std::optional<double> sigma_deg;
  bool is_by_orientation = false;
};

// The directions of gravity at the times of messages, which are in order. It is
// along -z of the world of the orientation, if all messages have one, or else
// opposite to the mean acceleration in the window around a time; empty if one
// has none. The gyroscope, if there is one, turns accelerations to the axes at
// that time. The standard deviation of means is that of the changes between
// adjacent windows; that of orientations contains that of the means. An
// orientation that never changes, or disagrees with the means, does not count.
MeasuredGravity MeasureGravity(const std::vector<ImuMessage>& messages,
                               double window_s);

}  // namespace mgsfm
