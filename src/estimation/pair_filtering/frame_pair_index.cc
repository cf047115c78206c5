// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/frame_pair_index.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include "base/natural_order.h"
#include "base/random.h"
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
  const bool has_times = HasTimes(scene, *frame_idxs);
  const auto time_of = [&](int i) { return TimeOfFrame(scene, i); };
  const auto name_of = [&](int i) -> const std::string& {
    return scene.frames[i].name;
  };
  if (has_times) {
    StableSortBy(frame_idxs, time_of);
  } else {
    std::stable_sort(frame_idxs->begin(), frame_idxs->end(), [&](int a, int b) {
      return IsNaturallyBefore(name_of(a), name_of(b));
    });
  }
  Intervals intervals;
  for (size_t k = 0; k + 1 < frame_idxs->size(); ++k) {
    const int frame = (*frame_idxs)[k], next = (*frame_idxs)[k + 1];
    if (has_times) {
      intervals.emplace_back(time_of(next) - time_of(frame));
    } else {
      intervals.push_back(NumberDifference(name_of(frame), name_of(next)));
    }
  }
  intervals = Normalized(std::move(intervals));
  if (!has_times) KeepCounts(&intervals);
  return intervals;
}

// The number of random permutations that may be as good as the order of a
// sequence: a random order passes with probability 1 / 2,000. Eight frames
// suffice.
constexpr int kNumPermutations = 3999;
constexpr int kMaxAsGood = 1;
// So many of them show the mean and the variance of the sums. By Cantelli's
// inequality, an order whose sum exceeds the mean by the root of n standard
// deviations is random with a probability below 1 / n, whatever the
// distribution.
constexpr int kNumForMoments = 100;

// The matches of two frames of a rig.
struct FrameLink {
  int frame_idx1 = 0, frame_idx2 = 0;
  size_t num_matches = 0;
  bool are_neighbors = false;
};

std::vector<FrameLink> LinksOfRigs(const std::vector<FramePair>& frame_pairs,
                                   const std::vector<MatchedImages>& pairs,
                                   const TemporalOrder& order) {
  std::vector<FrameLink> links;
  for (const FramePair& frames : frame_pairs) {
    const auto gap = order.Gap(frames.frame_idx1, frames.frame_idx2);
    if (!frames.IsBetweenFrames() || !gap) continue;
    links.push_back(
        {frames.frame_idx1, frames.frame_idx2, 0, *gap <= kMaxNeighborGap});
    for (const size_t i : frames.pair_idxs) {
      links.back().num_matches += pairs[i].num_matches;
    }
  }
  return links;
}

// Per frame, the largest number of matches with any other frame.
std::vector<size_t> MostMatches(const std::vector<FrameLink>& links,
                                size_t num_frames, bool only_neighbors) {
  std::vector<size_t> most(num_frames, 0);
  for (const FrameLink& link : links) {
    if (only_neighbors && !link.are_neighbors) continue;
    for (const int frame_idx : {link.frame_idx1, link.frame_idx2}) {
      most[frame_idx] = std::max(most[frame_idx], link.num_matches);
    }
  }
  return most;
}

// The matches of two frames, in thousandths of the maximum that either shares
// with any frame: integers, so that the sums of equally good orders are equal.
class Similarities {
 public:
  Similarities(const std::vector<FrameLink>& links,
               const std::vector<size_t>& most)
      : of_frame_(most.size()) {
    for (const auto& [frame_idx1, frame_idx2, num_matches, _] : links) {
      const size_t reference = std::max(most[frame_idx1], most[frame_idx2]);
      if (reference == 0) continue;
      const auto similarity = static_cast<int>(1000 * num_matches / reference);
      // Links are sorted by both frames.
      of_frame_[frame_idx1].emplace_back(frame_idx2, similarity);
    }
  }

  // The sum of similarities of neighbors in the runs; each gap counts half as
  // much as half the gap.
  int64_t Sum(const std::vector<std::vector<int>>& runs) const {
    int64_t sum = 0;
    for (const std::vector<int>& run : runs) {
      for (int gap = 1; gap <= kMaxNeighborGap; ++gap) {
        for (size_t k = gap; k < run.size(); ++k) {
          sum += Of(run[k - gap], run[k]) / gap;
        }
      }
    }
    return sum;
  }

 private:
  int Of(int frame_idx1, int frame_idx2) const {
    const auto [low, high] = std::minmax(frame_idx1, frame_idx2);
    const auto& row = of_frame_[low];
    if (row.empty() || row.back().first < high) return 0;
    const auto found =
        std::lower_bound(row.begin(), row.end(), std::pair(high, 0));
    return found->first == high ? found->second : 0;
  }

  // Similarities with frames of higher index, in ascending order.
  std::vector<std::vector<std::pair<int, int>>> of_frame_;
};

// The frames of each rig between breaks.
std::vector<std::vector<int>> UnbrokenRuns(const TemporalOrder& order) {
  std::vector<std::vector<int>> runs;
  for (const std::vector<int>& frames : order.sequences()) {
    for (size_t rank = 0; rank < frames.size(); ++rank) {
      if (rank == 0 || order.IsAfterBreak(frames[rank])) runs.emplace_back();
      runs.back().push_back(frames[rank]);
    }
  }
  return runs;
}

void Shuffle(std::vector<int>* values, Random* random) {
  for (size_t i = values->size(); i > 1; --i) {
    std::swap((*values)[i - 1],
              (*values)[random->Index(static_cast<uint32_t>(i))]);
  }
}

// Whether neighbors share more matches than in random orders. Frames are
// permuted only between breaks: unordered images of one recording match each
// other, but not those of another.
bool IsOrderSignificant(const Similarities& similarities,
                        std::vector<std::vector<int>> runs) {
  const int64_t observed = similarities.Sum(runs);
  Random random(0);
  int num_as_good = 0;
  double sum = 0.0, squares = 0.0;  // of the differences from the observed sum
  for (int i = 1; i <= kNumPermutations && num_as_good <= kMaxAsGood; ++i) {
    for (std::vector<int>& run : runs) Shuffle(&run, &random);
    const int64_t random_sum = similarities.Sum(runs);
    num_as_good += random_sum >= observed;
    const auto difference = static_cast<double>(observed - random_sum);
    sum += difference;
    squares += difference * difference;
    const double mean = sum / i;
    if (i == kNumForMoments && mean > 0.0 &&
        mean * mean > kNumPermutations * (squares / i - mean * mean)) {
      break;
    }
  }
  return num_as_good <= kMaxAsGood;
}

// Whether the order of the frames is that of a camera path. Chance does not
// explain it, and it is fine enough: most frames share at least half as many
// matches with a frame just before or after them as with any other frame of
// their rig. Where the path returns, the other visit may share more.
bool IsSequence(const std::vector<FrameLink>& links, const TemporalOrder& order,
                size_t num_frames) {
  const std::vector<size_t> most = MostMatches(links, num_frames, false);
  const std::vector<size_t> with_neighbor =
      MostMatches(links, num_frames, true);
  int num_near = 0, num_far = 0;
  for (size_t i = 0; i < num_frames; ++i) {
    if (most[i] == 0) continue;
    ++(2 * with_neighbor[i] >= most[i] ? num_near : num_far);
  }
  return num_near > num_far &&
         IsOrderSignificant(Similarities(links, most), UnbrokenRuns(order));
}

// Per rig.
std::vector<int> MeasureReaches(const std::vector<FramePair>& frame_pairs,
                                const TemporalOrder& order) {
  std::vector<std::vector<size_t>> num_linked;  // per rig and gap
  for (const std::vector<int>& frames : order.sequences()) {
    num_linked.emplace_back(std::max<size_t>(frames.size(), 1), 0);
  }
  for (const FramePair& frames : frame_pairs) {
    if (!frames.time_gap) continue;
    ++num_linked[order.RigOf(frames.frame_idx1)][*frames.time_gap];
  }
  std::vector<int> reaches;
  for (const std::vector<size_t>& linked : num_linked) {
    size_t reach = 1;
    while (reach + 1 < linked.size() &&
           2 * linked[reach + 1] >= linked.size() - reach - 1) {
      ++reach;
    }
    reaches.push_back(static_cast<int>(reach));
  }
  return reaches;
}

std::vector<MatchedImages> CountMatches(const ViewGraph& view_graph) {
  return Transformed(view_graph.pairs, [](const ImagePair& pair) {
    return MatchedImages{pair.image_idx1, pair.image_idx2, pair.matches.size()};
  });
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
  if (const auto previous = Previous(frame_idx)) neighbors.push_back(*previous);
  if (rank + 1 < frames.size()) neighbors.push_back(frames[rank + 1]);
  return neighbors;
}

std::optional<int> TemporalOrder::Gap(int frame_idx1, int frame_idx2) const {
  if (rig_of_frame_[frame_idx1] != rig_of_frame_[frame_idx2]) {
    return std::nullopt;
  }
  return std::abs(rank_of_frame_[frame_idx1] - rank_of_frame_[frame_idx2]);
}

FramePairIndex::FramePairIndex(const Scene& scene, const ViewGraph& view_graph,
                               SequenceMode sequence)
    : FramePairIndex(scene, CountMatches(view_graph), sequence) {}

FramePairIndex::FramePairIndex(const Scene& scene,
                               const std::vector<MatchedImages>& pairs,
                               SequenceMode sequence)
    : num_frames_(static_cast<int>(scene.frames.size())),
      frame_pair_of_pair_(pairs.size()) {
  std::vector<std::tuple<int, int, size_t>> order;
  order.reserve(pairs.size());
  for (size_t i = 0; i < pairs.size(); ++i) {
    const MatchedImages& pair = pairs[i];
    const auto [low, high] =
        std::minmax({scene.images[pair.image_idx1].frame_idx,
                     scene.images[pair.image_idx2].frame_idx});
    order.emplace_back(low, high, i);
  }
  std::sort(order.begin(), order.end());
  for (const auto& [low, high, i] : order) {
    if (frame_pairs_.empty() || frame_pairs_.back().frame_idx1 != low ||
        frame_pairs_.back().frame_idx2 != high) {
      frame_pairs_.push_back({low, high, {}});
    }
    frame_pairs_.back().pair_idxs.push_back(i);
    frame_pair_of_pair_[i] = frame_pairs_.size() - 1;
  }
  if (sequence == SequenceMode::kNo) return;
  TemporalOrder order_of_frames(scene);
  if (sequence == SequenceMode::kAuto &&
      !IsSequence(LinksOfRigs(frame_pairs_, pairs, order_of_frames),
                  order_of_frames, scene.frames.size())) {
    return;
  }
  order_ = std::move(order_of_frames);
  for (FramePair& frames : frame_pairs_) {
    frames.time_gap = order_->Gap(frames.frame_idx1, frames.frame_idx2);
  }
  reaches_ = MeasureReaches(frame_pairs_, *order_);
}

FramePairIndex::FramePairIndex(const Scene& scene, const ViewGraph& view_graph,
                               const FramePairIndex& whole)
    : FramePairIndex(scene, view_graph, SequenceMode::kNo) {
  order_ = whole.order_;
  reaches_ = whole.reaches_;
  if (!order_) return;
  for (FramePair& frames : frame_pairs_) {
    frames.time_gap = order_->Gap(frames.frame_idx1, frames.frame_idx2);
  }
}

std::vector<FramePair> FramePairIndex::FramePairsOf(const Mask& pairs) const {
  std::vector<FramePair> some = frame_pairs_;
  for (FramePair& frames : some) {
    EraseIf(&frames.pair_idxs, [&](size_t i) { return !pairs[i]; });
  }
  EraseIf(&some, [](const FramePair& f) { return f.pair_idxs.empty(); });
  return some;
}

const FramePair* FramePairIndex::Find(int frame_idx1, int frame_idx2) const {
  const std::pair<int, int> wanted = std::minmax(frame_idx1, frame_idx2);
  const auto frames_of = [](const FramePair& frames) {
    return std::pair(frames.frame_idx1, frames.frame_idx2);
  };
  const auto found =
      std::lower_bound(frame_pairs_.begin(), frame_pairs_.end(), wanted,
                       [&](const FramePair& frames, const auto& value) {
                         return frames_of(frames) < value;
                       });
  return found != frame_pairs_.end() && frames_of(*found) == wanted ? &*found
                                                                    : nullptr;
}

}  // namespace mgsfm
