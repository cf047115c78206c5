// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <optional>
#include <string>

#include "matching/pair_lists.h"
#include "matching/pair_selection.h"

namespace mgsfm {
namespace {

// "a/b/c.png" -> "a/b".
std::string Folder(const std::string& image_name) {
  const size_t slash = image_name.rfind('/');
  return slash == std::string::npos ? "" : image_name.substr(0, slash);
}

// Frame distances at which images are matched, ascending.
std::vector<int> FrameDistances(const SequentialPairOptions& options) {
  std::vector<int> distances;
  for (int d = 1; d <= options.overlap; ++d) distances.push_back(d);
  constexpr int kMaxExponent = 30;  // 2^30 fits into an int
  if (options.quadratic_overlap) {
    for (int k = 0; k < std::min(*options.overlap, kMaxExponent); ++k) {
      if ((1 << k) > options.overlap) distances.push_back(1 << k);
    }
  }
  return distances;
}

// The distances in frames at which different sensors are paired: those of one
// sensor, and 0.
std::vector<int> SensorPairDistances(const SequentialPairOptions& options) {
  std::vector<int> distances = FrameDistances(options);
  distances.insert(distances.begin(), 0);
  return distances;
}

// Indices of frames spaced evenly, including the first.
std::vector<int> ProbeFrames(const FrameSequence& sequence,
                             const SequentialPairOptions& options) {
  const int num_probes =
      std::min(*options.num_probe_frames, sequence.num_frames());
  std::vector<int> frames(num_probes);
  for (int i = 0; i < num_probes; ++i) {
    frames[i] =
        static_cast<int>(int64_t{i} * sequence.num_frames() / num_probes);
  }
  return frames;
}

// Calls visit(slot1, slot2, pair) for all images of different sensors in two
// frames. Within one frame, each pair of sensors is visited once.
template <class Visit>
void ForEachSensorPair(const FrameSequence& sequence, int frame1, int frame2,
                       const Visit& visit) {
  if (frame2 >= sequence.num_frames()) return;
  for (int slot1 = 0; slot1 < sequence.num_slots; ++slot1) {
    for (int slot2 = 0; slot2 < sequence.num_slots; ++slot2) {
      if (slot1 == slot2 || (frame1 == frame2 && slot1 > slot2)) continue;
      const std::optional<int> image1 = sequence.images[frame1][slot1];
      const std::optional<int> image2 = sequence.images[frame2][slot2];
      if (!image1 || !image2) continue;
      visit(slot1, slot2, internal::MakePair(*image1, *image2));
    }
  }
}

// Number of probes and of verified probes per pair of sensors, for one frame
// distance.
class SensorOverlap {
 public:
  SensorOverlap(int num_slots, double min_ratio)
      : num_slots_(num_slots),
        min_ratio_(min_ratio),
        counts_(static_cast<size_t>(num_slots) * num_slots) {}

  void Add(int slot1, int slot2, bool is_verified) {
    Count& count = counts_[slot1 * num_slots_ + slot2];
    ++count.num_probes;
    count.num_verified += is_verified ? 1 : 0;
  }
  bool Overlaps(int slot1, int slot2) const {
    const Count& count = counts_[slot1 * num_slots_ + slot2];
    // Sensors without images in the probe frames may overlap.
    if (count.num_probes == 0) return true;
    return count.num_verified > 0 &&
           count.num_verified >= min_ratio_ * count.num_probes;
  }

 private:
  struct Count {
    int num_probes = 0;
    int num_verified = 0;
  };
  int num_slots_;
  double min_ratio_;
  std::vector<Count> counts_;
};

}  // namespace

std::vector<FrameSequence> MakeFrameSequences(const Scene& scene) {
  // The key is the rig for rigs of several sensors, otherwise the folder.
  using Key = std::pair<std::optional<int>, std::string>;
  std::map<Key, std::vector<int>> frames_of_key;
  for (const int frame_idx : OrderOfFrames(scene)) {
    const Frame& frame = scene.frames[frame_idx];
    const bool is_single = scene.rigs[frame.rig_idx].sensor_idxs.size() == 1;
    const std::string& image_name = scene.images[frame.image_idxs.front()].name;
    frames_of_key[is_single ? Key(std::nullopt, Folder(image_name))
                            : Key(frame.rig_idx, "")]
        .push_back(frame_idx);
  }
  std::vector<FrameSequence> sequences;
  for (auto& [key, frame_idxs] : frames_of_key) {
    FrameSequence sequence;
    if (key.first) {
      sequence.num_slots =
          static_cast<int>(scene.rigs[*key.first].sensor_idxs.size());
    }
    for (const int frame_idx : frame_idxs) {
      std::vector<std::optional<int>>& images =
          sequence.images.emplace_back(sequence.num_slots);
      for (const int image_idx : scene.frames[frame_idx].image_idxs) {
        const Image& image = scene.images[image_idx];
        const std::vector<int>& sensors =
            scene.rigs[scene.frames[frame_idx].rig_idx].sensor_idxs;
        const auto slot =
            std::find(sensors.begin(), sensors.end(), image.sensor_idx);
        images[slot - sensors.begin()] = image_idx;
      }
    }
    sequence.frame_idxs = std::move(frame_idxs);
    sequences.push_back(std::move(sequence));
  }
  return sequences;
}

ImagePairList SameSensorPairs(const std::vector<FrameSequence>& sequences,
                              const SequentialPairOptions& options) {
  const std::vector<int> distances = FrameDistances(options);
  ImagePairList pairs;
  for (const FrameSequence& sequence : sequences) {
    for (int frame = 0; frame < sequence.num_frames(); ++frame) {
      for (const int distance : distances) {
        if (frame + distance >= sequence.num_frames()) break;
        for (int slot = 0; slot < sequence.num_slots; ++slot) {
          const auto& image1 = sequence.images[frame][slot];
          const auto& image2 = sequence.images[frame + distance][slot];
          if (!image1 || !image2) continue;
          pairs.push_back(internal::MakePair(*image1, *image2));
        }
      }
    }
  }
  internal::SortUnique(&pairs);
  return pairs;
}

ImagePairList ProbePairs(const std::vector<FrameSequence>& sequences,
                         const SequentialPairOptions& options) {
  ImagePairList pairs;
  if (!options.expand_rig_images) return pairs;
  for (const FrameSequence& sequence : sequences) {
    for (const int frame : ProbeFrames(sequence, options)) {
      for (const int distance : SensorPairDistances(options)) {
        ForEachSensorPair(
            sequence, frame, frame + distance,
            [&](int, int, const ImageIdxPair& pair) { pairs.push_back(pair); });
      }
    }
  }
  internal::SortUnique(&pairs);
  return pairs;
}

ImagePairList OverlappingSensorPairs(
    const std::vector<FrameSequence>& sequences,
    const SequentialPairOptions& options,
    const std::function<bool(const ImageIdxPair&)>& is_verified) {
  ImagePairList pairs;
  if (!options.expand_rig_images) return pairs;
  for (const FrameSequence& sequence : sequences) {
    const std::vector<int> probes = ProbeFrames(sequence, options);
    for (const int distance : SensorPairDistances(options)) {
      SensorOverlap overlap(sequence.num_slots, options.min_probe_ratio);
      for (const int frame : probes) {
        ForEachSensorPair(sequence, frame, frame + distance,
                          [&](int slot1, int slot2, const ImageIdxPair& pair) {
                            overlap.Add(slot1, slot2, is_verified(pair));
                          });
      }
      for (int frame = 0; frame < sequence.num_frames(); ++frame) {
        ForEachSensorPair(sequence, frame, frame + distance,
                          [&](int slot1, int slot2, const ImageIdxPair& pair) {
                            if (overlap.Overlaps(slot1, slot2))
                              pairs.push_back(pair);
                          });
      }
    }
  }
  internal::SortUnique(&pairs);
  return pairs;
}

}  // namespace mgsfm
