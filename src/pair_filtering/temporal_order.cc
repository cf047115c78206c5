// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/temporal_order.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <optional>
#include <utility>

#include "base/natural_order.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

bool HasTimes(const Scene& scene, const std::vector<int>& frame_idxs) {
  return std::all_of(frame_idxs.begin(), frame_idxs.end(), [&](int frame_idx) {
    const std::vector<int>& images = scene.frames[frame_idx].image_idxs;
    return std::all_of(images.begin(), images.end(), [&](int image_idx) {
      return scene.images[image_idx].timestamp_s.has_value();
    });
  });
}

// Sorts the frames of a rig by time. Per frame but the last: the time to the
// next one.
std::vector<std::optional<double>> SortByTime(const Scene& scene,
                                              std::vector<int>* frame_idxs) {
  const auto time_of = [&](int i) { return TimeOfFrame(scene, i); };
  std::stable_sort(frame_idxs->begin(), frame_idxs->end(),
                   [&](int a, int b) { return time_of(a) < time_of(b); });
  std::vector<std::optional<double>> intervals;
  for (size_t k = 0; k + 1 < frame_idxs->size(); ++k) {
    intervals.emplace_back(time_of((*frame_idxs)[k + 1]) -
                           time_of((*frame_idxs)[k]));
  }
  return intervals;
}

// The same by name; nullopt if the next name does not differ by a number.
std::vector<std::optional<double>> SortByName(const Scene& scene,
                                              std::vector<int>* frame_idxs) {
  const auto name_of = [&](int i) { return scene.frames[i].name; };
  std::stable_sort(frame_idxs->begin(), frame_idxs->end(), [&](int a, int b) {
    return IsNaturallyBefore(name_of(a), name_of(b));
  });
  std::vector<std::optional<double>> intervals;
  for (size_t k = 0; k + 1 < frame_idxs->size(); ++k) {
    intervals.push_back(NumberDifference(name_of((*frame_idxs)[k]),
                                         name_of((*frame_idxs)[k + 1])));
  }
  return intervals;
}

// The median of the known intervals, if it is positive.
std::optional<double> MedianOf(
    const std::vector<std::optional<double>>& intervals) {
  std::vector<double> known;
  for (const auto& interval : intervals) {
    if (interval) known.push_back(*interval);
  }
  if (known.empty()) return std::nullopt;
  const double median = Median(std::move(known));
  return median > 0.0 ? std::optional(median) : std::nullopt;
}

// Sorts the frames of a rig and assigns their times, in median intervals.
void AssignTimes(const Scene& scene, std::vector<int>* frame_idxs,
                 std::vector<double>* time_of_frame) {
  const auto intervals = HasTimes(scene, *frame_idxs)
                             ? SortByTime(scene, frame_idxs)
                             : SortByName(scene, frame_idxs);
  const std::optional<double> median = MedianOf(intervals);
  for (size_t k = 0; k < intervals.size(); ++k) {
    const double duration =
        intervals[k] && median ? *intervals[k] / *median : 1.0;
    (*time_of_frame)[(*frame_idxs)[k + 1]] =
        (*time_of_frame)[(*frame_idxs)[k]] + duration;
  }
}

}  // namespace

TemporalOrder::TemporalOrder(const Scene& scene)
    : rank_of_frame_(scene.frames.size()),
      time_of_frame_(scene.frames.size(), 0.0),
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
    AssignTimes(scene, &frames, &time_of_frame_);
    for (size_t rank = 0; rank < frames.size(); ++rank) {
      rank_of_frame_[frames[rank]] = static_cast<int>(rank);
    }
  }
}

std::optional<int> TemporalOrder::Gap(int frame_idx1, int frame_idx2) const {
  if (rig_of_frame_[frame_idx1] != rig_of_frame_[frame_idx2]) {
    return std::nullopt;
  }
  return std::abs(rank_of_frame_[frame_idx1] - rank_of_frame_[frame_idx2]);
}

}  // namespace mgsfm
