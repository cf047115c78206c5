// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/temporal_order.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <optional>
#include <string>
#include <utility>

#include "base/natural_order.h"
#include "base/ranges.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

// Intervals between a tenth of the median and ten medians belong to one
// recording. Key frames of a hovering drone are up to 7.3 s apart, 1.35 s on
// average (EuRoC V1_01).
constexpr double kMaxInterval = 10.0;

bool HasTimes(const Scene& scene, const std::vector<int>& frame_idxs) {
  return AllOf(frame_idxs, [&](int frame_idx) {
    const std::vector<int>& images = scene.frames[frame_idx].image_idxs;
    return AllOf(images, [&](int image_idx) {
      return scene.images[image_idx].timestamp_s.has_value();
    });
  });
}

// The time from each frame to the next, in any unit; nullopt if it is unknown.
using Intervals = std::vector<std::optional<double>>;

Intervals SortByTime(const Scene& scene, std::vector<int>* frame_idxs) {
  const auto time_of = [&](int i) { return TimeOfFrame(scene, i); };
  StableSortBy(frame_idxs, time_of);
  Intervals intervals;
  for (size_t k = 0; k + 1 < frame_idxs->size(); ++k) {
    intervals.emplace_back(time_of((*frame_idxs)[k + 1]) -
                           time_of((*frame_idxs)[k]));
  }
  return intervals;
}

Intervals SortByName(const Scene& scene, std::vector<int>* frame_idxs) {
  const auto name_of = [&](int i) -> const std::string& {
    return scene.frames[i].name;
  };
  std::stable_sort(frame_idxs->begin(), frame_idxs->end(), [&](int a, int b) {
    return IsNaturallyBefore(name_of(a), name_of(b));
  });
  Intervals intervals;
  for (size_t k = 0; k + 1 < frame_idxs->size(); ++k) {
    intervals.push_back(NumberDifference(name_of((*frame_idxs)[k]),
                                         name_of((*frame_idxs)[k + 1])));
  }
  return intervals;
}

// Divides intervals by their median; nonpositive intervals become unknown.
Intervals Normalized(Intervals intervals) {
  std::vector<double> known;
  for (auto& interval : intervals) {
    if (interval && *interval <= 0.0) interval.reset();
    if (interval) known.push_back(*interval);
  }
  if (known.empty()) return intervals;
  const double median = Median(std::move(known));
  for (auto& interval : intervals) {
    if (interval) *interval /= median;
  }
  return intervals;
}

// Dates and counters that restart change by amounts that are not times.
void KeepCounts(Intervals* intervals) {
  for (auto& interval : *intervals) {
    if (interval &&
        (*interval * kMaxInterval < 1.0 || *interval > kMaxInterval)) {
      interval.reset();
    }
  }
}

// Sorts the frames of a rig.
Intervals SortFrames(const Scene& scene, std::vector<int>* frame_idxs) {
  if (HasTimes(scene, *frame_idxs)) {
    return Normalized(SortByTime(scene, frame_idxs));
  }
  Intervals intervals = Normalized(SortByName(scene, frame_idxs));
  KeepCounts(&intervals);
  return intervals;
}

}  // namespace

TemporalOrder::TemporalOrder(const Scene& scene)
    : rank_of_frame_(scene.frames.size()),
      time_of_frame_(scene.frames.size(), 0.0),
      is_after_break_(scene.frames.size(), false),
      sequences_(scene.rigs.size()) {
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const int rig_idx = scene.frames[i].rig_idx;
    rig_of_frame_.push_back(rig_idx);
    if (rig_idx >= static_cast<int>(sequences_.size())) {
      sequences_.resize(rig_idx + 1);
    }
    sequences_[rig_idx].push_back(static_cast<int>(i));
  }
  for (std::vector<int>& frames : sequences_) {
    const Intervals intervals = SortFrames(scene, &frames);
    const bool are_unknown = NoneOf(
        intervals, [](const auto& interval) { return interval.has_value(); });
    for (size_t rank = 0; rank < frames.size(); ++rank) {
      rank_of_frame_[frames[rank]] = static_cast<int>(rank);
      if (rank == 0) continue;
      const auto& interval = intervals[rank - 1];
      const double duration = interval.value_or(1.0);
      time_of_frame_[frames[rank]] =
          time_of_frame_[frames[rank - 1]] + duration;
      is_after_break_[frames[rank]] =
          std::round(duration) > kMaxInterval || (!interval && !are_unknown);
    }
  }
}

std::vector<int> TemporalOrder::Neighbors(int frame_idx) const {
  const std::vector<int>& frames = sequences_[rig_of_frame_[frame_idx]];
  const auto rank = static_cast<size_t>(rank_of_frame_[frame_idx]);
  std::vector<int> neighbors;
  if (rank > 0) neighbors.push_back(frames[rank - 1]);
  if (rank + 1 < frames.size()) neighbors.push_back(frames[rank + 1]);
  return neighbors;
}

std::optional<int> TemporalOrder::Gap(int frame_idx1, int frame_idx2) const {
  if (rig_of_frame_[frame_idx1] != rig_of_frame_[frame_idx2]) {
    return std::nullopt;
  }
  return std::abs(rank_of_frame_[frame_idx1] - rank_of_frame_[frame_idx2]);
}

}  // namespace mgsfm
