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
  std::optional<double> mean_acceleration;  // m/s^2, the median over windows
  bool is_by_orientation = false;
};

// The directions of gravity at the times of messages, which are in order. It is
// along -z of the world of the orientation, or else opposite to the mean
// acceleration in the window around a time. The gyroscope, if there is one,
// turns accelerations to the axes at that time. Windows end at gaps of more
// than ten median intervals, and parts between gaps that are shorter than half
// a window have no mean, unless all are. The standard deviation of means is
// that of the changes between adjacent windows; that of orientations contains
// that of the means.
//
// Messages that lack a quantity do not count for it. Nor do means of a length
// other than that of gravity, and an orientation that never changes or
// disagrees with the means; there are no directions if nothing is left.
MeasuredGravity MeasureGravity(std::vector<ImuMessage> messages,
                               double window_s);

}  // namespace mgsfm
