// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/temporal_order.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <map>
#include <utility>

#include "base/natural_order.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

// One frame may be missing or blurred.
constexpr int kMaxNeighbourGap = 2;
// Simulated drives have shares of 0.98 to 1, in random order 0.05.
constexpr double kMinShareOfNeighbours = 0.75;
constexpr double kMaxShareInRandomOrder = 0.25;

using MatchesOfFrames = std::map<std::pair<int, int>, size_t>;

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

// The expected share of frames that share half of their `most` matches with one
// of 2 * kMaxNeighbourGap frames drawn at random.
double ShareInRandomOrder(const MatchesOfFrames& num_matches,
                          const std::vector<size_t>& most, double num_frames) {
  double num_strong = 0.0;
  for (const auto& [frames, number] : num_matches) {
    num_strong += 2 * number >= most[frames.first];
    num_strong += 2 * number >= most[frames.second];
  }
  const double density = num_strong / (num_frames * (num_frames - 1.0));
  return 1.0 - std::pow(1.0 - density, 2 * kMaxNeighbourGap);
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

bool IsSequence(const Scene& scene, const ViewGraph& view_graph,
                const TemporalOrder& order) {
  MatchesOfFrames num_matches;
  for (const ImagePair& pair : view_graph.pairs) {
    const auto frames = std::minmax({scene.images[pair.image_idx1].frame_idx,
                                     scene.images[pair.image_idx2].frame_idx});
    if (frames.first != frames.second &&
        order.Gap(frames.first, frames.second)) {
      num_matches[frames] += pair.matches.size();
    }
  }
  // Per frame: the most matches with any frame, and with a neighbour in time.
  std::vector<size_t> most(scene.frames.size(), 0), most_with_neighbour = most;
  for (const auto& [frames, number] : num_matches) {
    const bool are_neighbours =
        *order.Gap(frames.first, frames.second) <= kMaxNeighbourGap;
    for (const int frame_idx : {frames.first, frames.second}) {
      most[frame_idx] = std::max(most[frame_idx], number);
      if (!are_neighbours) continue;
      most_with_neighbour[frame_idx] =
          std::max(most_with_neighbour[frame_idx], number);
    }
  }
  double num_frames = 0.0, num_with_strongest = 0.0, num_with_strong = 0.0;
  for (size_t i = 0; i < most.size(); ++i) {
    num_frames += most[i] > 0;
    num_with_strongest += most[i] > 0 && most_with_neighbour[i] == most[i];
    num_with_strong += most[i] > 0 && 2 * most_with_neighbour[i] >= most[i];
  }
  const double min_number = kMinShareOfNeighbours * num_frames;
  return num_frames > 0.0 && num_with_strong >= min_number &&
         (num_with_strongest >= min_number ||
          ShareInRandomOrder(num_matches, most, num_frames) <=
              kMaxShareInRandomOrder);
}

}  // namespace mgsfm
