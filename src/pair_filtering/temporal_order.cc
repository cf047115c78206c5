// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/temporal_order.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
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

// Sorts the frames of a rig and assigns their times.
void SortByTime(const Scene& scene, std::vector<int>* frame_idxs,
                std::vector<double>* time_of_frame) {
  if (!HasTimes(scene, *frame_idxs)) {
    std::stable_sort(frame_idxs->begin(), frame_idxs->end(), [&](int a, int b) {
      return IsNaturallyBefore(scene.frames[a].name, scene.frames[b].name);
    });
    for (size_t k = 0; k < frame_idxs->size(); ++k) {
      (*time_of_frame)[(*frame_idxs)[k]] = static_cast<double>(k);
    }
    return;
  }
  std::vector<double>& times = *time_of_frame;
  for (const int i : *frame_idxs) times[i] = TimeOfFrame(scene, i);
  std::stable_sort(frame_idxs->begin(), frame_idxs->end(),
                   [&](int a, int b) { return times[a] < times[b]; });
  std::vector<double> intervals;
  for (size_t k = 0; k + 1 < frame_idxs->size(); ++k) {
    intervals.push_back(times[(*frame_idxs)[k + 1]] - times[(*frame_idxs)[k]]);
  }
  const double median = intervals.empty() ? 0.0 : Median(std::move(intervals));
  if (median <= 0.0) return;
  for (const int i : *frame_idxs) times[i] /= median;
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
    SortByTime(scene, &frames, &time_of_frame_);
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
