// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "rigs/rig_inference.h"

namespace mgsfm {

// Times of all images, and how far apart those of one frame may be.
struct FrameTimes {
  std::vector<int64_t> times_ns;  // per image
  int64_t max_difference_ns = 0;
};

// A camera of a rig whose frames are sought.
struct TimedSensor {
  std::string name;
  int rig = 0;
  bool is_reference = false;
};

struct FramesByTime {
  struct Frame {
    int rig = 0;
    int64_t time_ns = 0;  // of its image of the first sensor
    std::string name;     // seconds with nine decimals
  };
  std::vector<Frame> frames;
  std::vector<int> frame_of_image;  // -1: the image has no sensor

  // The pairing of all sensors but the first of each rig, in their order.
  struct Pairing {
    int sensor = 0;
    int first_sensor = 0;  // of the rig
    size_t num_images = 0;
    std::vector<int64_t> differences_ns;  // later than the frame; per pair
    // The smallest difference of an image without a partner.
    int64_t nearest_ns = std::numeric_limits<int64_t>::max();
  };
  std::vector<Pairing> pairings;
  // Two images of one sensor with one time.
  std::optional<std::pair<int, int>> same_time;
};

// Pairs the images of the sensors of each rig one to one. The sensors join one
// after the other: the reference, then by descending number of images, then by
// name. An image and a frame are paired if each is the nearest of the other and
// they are at most max_difference_ns apart; of two that are equally near, the
// earlier one counts. Images without a partner become frames. Sensor -1: the
// image takes no part. Cost: O(n log n) per sensor.
FramesByTime FindFramesByTime(const std::vector<TimedSensor>& sensors,
                              const std::vector<int>& sensor_of_image,
                              const FrameTimes& times);

// Logs the pairs, the images without a partner, and the distribution of
// differences of each sensor. Throws Error if there is no pair, or if two
// images of a sensor have one time.
void ReportFramesByTime(const RigInput& input,
                        const std::vector<TimedSensor>& sensors,
                        const std::vector<int>& sensor_of_image,
                        const FramesByTime& frames, const FrameTimes& times,
                        const Context& context);

// Replaces the frames of the keys by those of their times.
void SetFramesByTime(const RigInput& input, const FrameTimes& times,
                     const Context& context, std::vector<ImageKeys>* keys);

// A difference that pairs most images of folders that share no names, if their
// names have times, in words as a remedy; nullopt if there is none. `keys` name
// the cameras.
std::optional<std::string> SuggestFramesByTime(
    const RigInput& input, const std::vector<ImageKeys>& keys);

}  // namespace mgsfm
