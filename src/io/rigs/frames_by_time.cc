// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <map>
#include <utility>

#include "base/format.h"
#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "rigs/image_times.h"
#include "rigs/rig_inference.h"

namespace mgsfm {
namespace {

constexpr const char* kOption = "frame_max_time_difference_s";
// An offset is called constant if it is this many times the median absolute
// deviation from it; for normal errors, that is 3.4 standard deviations.
constexpr double kMinOffsetInDeviations = 5.0;

std::string FormatTime(int64_t time_ns) {
  const std::string text =
      Formatted("%lld.%09lld", static_cast<long long>(time_ns / kNsPerSecond),
                static_cast<long long>(std::llabs(time_ns % kNsPerSecond)));
  return time_ns < 0 && time_ns > -kNsPerSecond ? "-" + text : text;
}

std::string FormatDuration(double duration_ns) {
  const std::pair<double, const char*> units[] = {
      {1e9, "s"}, {1e6, "ms"}, {1e3, "us"}, {1.0, "ns"}};
  for (const auto& [size_ns, name] : units) {
    if (std::abs(duration_ns) < size_ns) continue;
    return Formatted("%.3g %s", duration_ns / size_ns, name);
  }
  return "0 ns";
}

// A frame or image, by its time.
struct Instant {
  int64_t time_ns = 0;
  int number = 0;

  bool operator<(const Instant& other) const {
    return std::make_pair(time_ns, number) <
           std::make_pair(other.time_ns, other.number);
  }
};

// The position of the nearest instant, the earlier one of two.
size_t FindNearest(const std::vector<Instant>& sorted, int64_t time_ns) {
  const auto find = [&](int64_t time) {
    return std::lower_bound(sorted.begin(), sorted.end(), Instant{time, 0});
  };
  const auto after = find(time_ns);
  if (after == sorted.begin()) return 0;
  const auto before = find(std::prev(after)->time_ns);
  const bool is_later = after == sorted.end() ||
                        time_ns - before->time_ns <= after->time_ns - time_ns;
  return static_cast<size_t>((is_later ? before : after) - sorted.begin());
}

// The pairing of every sensor but the first of each rig, in order.
struct Pairing {
  int sensor = 0;
  int first_sensor = 0;  // of the rig
  size_t num_images = 0;
  std::vector<int64_t> differences_ns;  // later than the frame; per pair
  // The smallest difference of an image without a partner.
  int64_t nearest_ns = std::numeric_limits<int64_t>::max();
};

struct PairedFrames {
  std::vector<Pairing> pairings;
  // Two images of one sensor with one time.
  std::optional<std::pair<int, int>> same_time;
};

// Sets the frames of an assignment with sensors.
class FramePairer {
 public:
  FramePairer(const TimedImages& times, RigAssignment* assignment)
      : sensors_(assignment->sensors),
        times_(times),
        assignment_(*assignment),
        images_of_sensor_(assignment->sensors.size()) {}

  PairedFrames Find() {
    const std::vector<int>& sensor_of_image = assignment_.sensor_of_image;
    assignment_.frame_of_image.assign(sensor_of_image.size(), -1);
    for (size_t i = 0; i < sensor_of_image.size(); ++i) {
      if (sensor_of_image[i] < 0) continue;
      images_of_sensor_[sensor_of_image[i]].push_back(
          {times_.times_ns[i], static_cast<int>(i)});
    }
    std::map<int, std::vector<int>> sensors_of_rig;
    for (const int sensor : SortedSensors()) {
      std::sort(images_of_sensor_[sensor].begin(),
                images_of_sensor_[sensor].end());
      FindSameTime(images_of_sensor_[sensor]);
      sensors_of_rig[sensors_[sensor].rig].push_back(sensor);
    }
    for (const auto& [rig, sensors] : sensors_of_rig) PairRig(sensors);
    return std::move(result_);
  }

 private:
  std::vector<int> SortedSensors() const;
  void FindSameTime(const std::vector<Instant>& images);
  void PairRig(const std::vector<int>& sensors);
  Pairing PairSensor(const std::vector<Instant>& images,
                     std::vector<Instant>* frames, int rig);
  Instant AddFrame(const Instant& image, int rig);

  const std::vector<RigAssignment::Sensor>& sensors_;
  const TimedImages& times_;
  RigAssignment& assignment_;
  std::vector<std::vector<Instant>> images_of_sensor_;
  PairedFrames result_;
};

std::vector<int> FramePairer::SortedSensors() const {
  std::vector<int> order;
  for (size_t i = 0; i < sensors_.size(); ++i) {
    if (!images_of_sensor_[i].empty()) order.push_back(static_cast<int>(i));
  }
  SortBy(&order, [this](int i) {
    return std::make_tuple(!sensors_[i].is_reference,
                           -static_cast<int64_t>(images_of_sensor_[i].size()),
                           sensors_[i].name, i);
  });
  return order;
}

void FramePairer::FindSameTime(const std::vector<Instant>& images) {
  const auto same = std::adjacent_find(images.begin(), images.end(),
                                       [](const Instant& a, const Instant& b) {
                                         return a.time_ns == b.time_ns;
                                       });
  if (same == images.end() || result_.same_time) return;
  result_.same_time.emplace(same->number, std::next(same)->number);
}

Instant FramePairer::AddFrame(const Instant& image, int rig) {
  const int frame = static_cast<int>(assignment_.frames.size());
  assignment_.frames.push_back({rig, FormatTime(image.time_ns), {}});
  assignment_.frame_of_image[image.number] = frame;
  return {image.time_ns, frame};
}

void FramePairer::PairRig(const std::vector<int>& sensors) {
  const int rig = sensors_[sensors.front()].rig;
  std::vector<Instant> frames;
  for (const int sensor : sensors) {
    Pairing pairing = PairSensor(images_of_sensor_[sensor], &frames, rig);
    if (sensor == sensors.front()) continue;
    pairing.sensor = sensor;
    pairing.first_sensor = sensors.front();
    result_.pairings.push_back(std::move(pairing));
  }
}

Pairing FramePairer::PairSensor(const std::vector<Instant>& images,
                                std::vector<Instant>* frames, int rig) {
  Pairing pairing;
  pairing.num_images = images.size();
  std::vector<Instant> added;
  for (size_t i = 0; i < images.size(); ++i) {
    if (!frames->empty()) {
      const Instant& frame = (*frames)[FindNearest(*frames, images[i].time_ns)];
      const int64_t later_ns = images[i].time_ns - frame.time_ns;
      if (std::abs(later_ns) <= times_.max_difference_ns &&
          FindNearest(images, frame.time_ns) == i) {
        assignment_.frame_of_image[images[i].number] = frame.number;
        pairing.differences_ns.push_back(later_ns);
        continue;
      }
      pairing.nearest_ns = std::min(pairing.nearest_ns, std::abs(later_ns));
    }
    added.push_back(AddFrame(images[i], rig));
  }
  const auto middle = static_cast<long>(frames->size());
  frames->insert(frames->end(), added.begin(), added.end());
  std::inplace_merge(frames->begin(), frames->begin() + middle, frames->end());
  return pairing;
}

void CheckDistinct(const RigInput& input, const PairedFrames& found,
                   const TimedImages& times) {
  if (!found.same_time) return;
  const auto name = [&](int image) {
    return "'" + input.contents.images[image].name + "'";
  };
  const auto& [image1, image2] = *found.same_time;
  throw Error(input.Name() + ": images " + name(image1) + " and " +
              name(image2) + " of one camera have the same time " +
              FormatTime(times.times_ns[image1]) +
              " s; give distinct times with image_timestamps_path, or do not "
              "set " +
              kOption);
}

// The distribution of differences, and an offset that all of them share.
std::string DescribeDifferences(const std::vector<int64_t>& differences_ns) {
  std::vector<double> signed_ns(differences_ns.begin(), differences_ns.end());
  std::vector<double> sizes_ns;
  std::vector<double> deviations_ns;
  const double offset_ns = Median(signed_ns);
  for (const double difference : signed_ns) {
    sizes_ns.push_back(std::abs(difference));
    deviations_ns.push_back(std::abs(difference - offset_ns));
  }
  std::string text =
      "times differ by " + FormatDuration(Median(sizes_ns)) +
      " in the median, by " +
      FormatDuration(*std::max_element(sizes_ns.begin(), sizes_ns.end())) +
      " at most";
  const double deviation_ns = Median(deviations_ns);
  if (std::abs(offset_ns) > kMinOffsetInDeviations * deviation_ns) {
    text += std::string("; a constant offset: ") +
            (offset_ns > 0.0 ? "later" : "earlier") + " by " +
            FormatDuration(std::abs(offset_ns));
  }
  return text;
}

std::string Limit(const TimedImages& times) {
  return FormatDuration(static_cast<double>(times.max_difference_ns));
}

void CheckPaired(const RigInput& input, const std::vector<Pairing>& pairings,
                 const TimedImages& times) {
  int64_t smallest_ns = std::numeric_limits<int64_t>::max();
  for (const Pairing& pairing : pairings) {
    if (!pairing.differences_ns.empty()) return;
    smallest_ns = std::min(smallest_ns, pairing.nearest_ns);
  }
  const std::string remedy =
      pairings.empty()
          ? "; there is only one camera: put the images of each camera into a "
            "folder of its own, or set rig_name_rule"
          : ", the nearest are " +
                FormatDuration(static_cast<double>(smallest_ns)) +
                " apart; increase " + kOption +
                ", or check that the clocks of the cameras agree";
  throw Error(input.Name() +
              ": no two images of different cameras are at most " +
              Limit(times) + " apart" + remedy);
}

// Names the sensors with images that are alone in their frame.
void WarnOfSingleImages(const RigInput& input, const RigAssignment& assignment,
                        const TimedImages& times, const Context& context) {
  const std::vector<int>& frame_of_image = assignment.frame_of_image;
  std::vector<size_t> frame_sizes(assignment.frames.size(), 0);
  for (const int frame : frame_of_image) {
    if (frame >= 0) ++frame_sizes[frame];
  }
  std::vector<std::vector<size_t>> single_images(assignment.sensors.size());
  for (size_t i = 0; i < frame_of_image.size(); ++i) {
    if (frame_of_image[i] >= 0 && frame_sizes[frame_of_image[i]] == 1) {
      single_images[assignment.sensor_of_image[i]].push_back(i);
    }
  }
  for (size_t s = 0; s < single_images.size(); ++s) {
    if (single_images[s].empty()) continue;
    context.Warning(std::to_string(single_images[s].size()) + " images of '" +
                    assignment.sensors[s].name + "' have no partner within " +
                    Limit(times) + "; the first is '" +
                    input.contents.images[single_images[s].front()].name + "'");
  }
}

// Rounds up to one digit.
double RoundUp(double value) {
  const double unit = std::pow(10.0, std::floor(std::log10(value)));
  return std::ceil(value / unit - 1e-9) * unit;
}

// An assignment with sensors only.
RigAssignment SensorsOfKeys(const std::vector<ImageKeys>& keys) {
  RigAssignment result;
  Numbering<> rigs, sensors;
  for (const ImageKeys& key : keys) {
    const int sensor = sensors(key.sensor);
    result.sensors.resize(sensors.size());
    result.sensors[sensor].rig = rigs(key.rig);
    result.sensors[sensor].name = key.sensor_name;
    result.sensor_of_image.push_back(sensor);
  }
  return result;
}

// Half of the median time between images of a sensor, over all sensors.
int64_t HalfInterval(const RigAssignment& sensors,
                     const std::vector<int64_t>& times) {
  std::vector<std::vector<int64_t>> times_of_sensor(sensors.sensors.size());
  for (size_t i = 0; i < times.size(); ++i) {
    times_of_sensor[sensors.sensor_of_image[i]].push_back(times[i]);
  }
  std::vector<double> intervals_ns;
  for (std::vector<int64_t>& sorted : times_of_sensor) {
    std::sort(sorted.begin(), sorted.end());
    for (size_t i = 1; i < sorted.size(); ++i) {
      intervals_ns.push_back(static_cast<double>(sorted[i] - sorted[i - 1]));
    }
  }
  if (intervals_ns.empty()) return 0;
  return static_cast<int64_t>(Median(std::move(intervals_ns)) / 2.0);
}

}  // namespace

void PairByTime(const RigInput& input, const TimedImages& times,
                const Context& context, RigAssignment* assignment) {
  const PairedFrames found = FramePairer(times, assignment).Find();
  CheckDistinct(input, found, times);
  CheckPaired(input, found.pairings, times);
  for (const Pairing& pairing : found.pairings) {
    if (pairing.differences_ns.empty()) continue;
    context.Info(
        "frames by time: '" + assignment->sensors[pairing.sensor].name +
        "': " + std::to_string(pairing.differences_ns.size()) + " of " +
        std::to_string(pairing.num_images) + " images paired with those of '" +
        assignment->sensors[pairing.first_sensor].name + "'; " +
        DescribeDifferences(pairing.differences_ns));
  }
  WarnOfSingleImages(input, *assignment, times, context);
}

void SetFramesByTime(const RigInput& input, const TimedImages& times,
                     const Context& context, std::vector<ImageKeys>* keys) {
  RigAssignment paired = SensorsOfKeys(*keys);
  PairByTime(input, times, context, &paired);
  for (size_t i = 0; i < keys->size(); ++i) {
    const int frame = paired.frame_of_image[i];
    (*keys)[i].frame = std::to_string(frame);
    (*keys)[i].frame_name = paired.frames[frame].name;
  }
}

std::optional<std::string> SuggestFramesByTime(
    const RigInput& input, const std::vector<ImageKeys>& keys) {
  RigAssignment sensors = SensorsOfKeys(keys);
  TimedImages times;
  for (const ImageRow& image : input.contents.images) {
    const std::optional<int64_t> time_ns = TimeInName(image.name);
    if (!time_ns) return std::nullopt;
    times.times_ns.push_back(*time_ns);
  }
  times.max_difference_ns = HalfInterval(sensors, times.times_ns);
  if (sensors.sensors.size() < 2 || times.max_difference_ns == 0) {
    return std::nullopt;
  }
  const PairedFrames found = FramePairer(times, &sensors).Find();
  if (found.same_time) return std::nullopt;
  size_t num_images = 0;
  size_t num_pairs = 0;
  int64_t largest_ns = 1;
  for (const Pairing& pairing : found.pairings) {
    num_images += pairing.num_images;
    num_pairs += pairing.differences_ns.size();
    for (const int64_t difference_ns : pairing.differences_ns) {
      largest_ns = std::max<int64_t>(largest_ns, std::abs(difference_ns));
    }
  }
  if (2 * num_pairs < num_images) return std::nullopt;
  const double limit_ns =
      std::min(RoundUp(2.0 * static_cast<double>(largest_ns)),
               static_cast<double>(times.max_difference_ns));
  const std::string value = Formatted("%g", 1e-9 * limit_ns);
  return "the " + std::to_string(sensors.sensors.size()) +
         " folders of images share few names, but the times in their names "
         "agree within " +
         FormatDuration(static_cast<double>(largest_ns)) + "; set " + kOption +
         " " + value + " to make them frames of one rig";
}

}  // namespace mgsfm
